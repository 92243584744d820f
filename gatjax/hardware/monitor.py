"""The monitor port of SimSpark: where the robot is, and what a trainer may do."""

from __future__ import annotations

import re

from gatjax.hardware.agent import Agent
from gatjax.records import Base

EVERY = 5  # frames between two questions for the whole state
TORSO = re.compile(
    r"\(nd TRF \(SLT ([^()]*)\)\(nd StaticMesh[^()]*\([^()]*\)\s*\(load models/naobody"
)


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
