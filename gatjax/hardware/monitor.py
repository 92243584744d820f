"""The monitor port of SimSpark: where a robot is that has no GPS."""

from __future__ import annotations

import re

import numpy as np

from gatjax.hardware.agent import Agent
from gatjax.hardware.poses import placed
from gatjax.records import Base

EVERY = 5  # frames between two questions for the whole state
BODY = re.compile(
    r"\(nd TRF \(SLT ([^()]*)\)\(nd TRF \(SLT [^()]*\)"
    r"\(nd StaticMesh \(setVisible 1\) \(load models/naobody"
)
"""The frame of the torso, just above the frame of its mesh."""
FORWARD = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
"""Axes forward, left, up of the torso in its own axes right, forward, up: columns."""


def torso(state: str) -> Base | None:
    """Find the torso of the only robot in a whole state, None if it has none.

    Its matrix lies there column by column; the torso's axes are right, forward, up.
    """
    found = BODY.search(state)
    if found is None:
        return None
    pose = np.array(found.group(1).split(), float).reshape(4, 4).T
    pose[:3, :3] = pose[:3, :3] @ FORWARD
    return placed(pose)


class Monitor:
    """Asks a server for the place of the only robot on its field."""

    def __init__(self, host: str, port: int) -> None:
        """Connect.

        Raises:
            Lost: one line: nobody is there.
        """
        self.agent = Agent(host, port, "is that the monitor port?")
        self._latest: Base | None = None
        self._count = 0

    def base(self) -> Base | None:
        """Return where the robot was last seen, some frames ago at most."""
        if self._count % EVERY == 0:
            self.agent.send("(reqfullstate)")
        self._count += 1
        while True:
            text = self.agent.receive(1e-4)
            if text is None:
                return self._latest
            self._latest = torso(text) or self._latest

    def close(self) -> None:
        """Leave."""
        self.agent.close()
