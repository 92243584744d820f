"""rcssservermj, the MuJoCo server of the RoboCup 3D league: its robots, not a NAO.

Same messages as SimSpark's with other words: every joint is told an angle, a speed, the
gains of its servo and a torque; the robot's place is in every percept. There is no
policy for these robots here: whoever connects tells joints by name.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from gatjax.hardware.agent import Agent, named, parse
from gatjax.hardware.frames import BadFrame, Lost

Array = Any

PATIENCE = 10.0  # s
HINT = "start it: rcssservermj --sync --no-realtime --no-render (pip install rcsssmj)"


class Percept(NamedTuple):
    """What a robot of rcssservermj reports."""

    time: float  # s
    angle: dict[str, float]  # rad, by joint: "lj1" of the left leg is "llj1"
    velocity: dict[str, float]  # rad/s
    position: Array  # [3] m, torso
    quaternion: Array  # [4] w x y z, torso to world


class Player:
    """One robot on the field of a server that waits for answers (--sync)."""

    def __init__(self, host: str, port: int, model: str = "T1") -> None:
        """Put a robot on the field: T1, K1 or ant.

        Raises:
            Lost: one line: nobody is there, or does not answer.
        """
        self.agent = Agent(host, port, HINT)
        self.agent.send(f"(init {model} gatjax 1)")

    def receive(self) -> Percept:
        """Return the next percept.

        Raises:
            BadFrame: it cannot be read.
            Lost: there is none.
        """
        text = self.agent.receive(PATIENCE)
        if text is None:
            raise Lost(f"{self.agent.place}: silent for {PATIENCE:g} s")
        try:
            return _percept(parse(text))
        except (KeyError, IndexError, TypeError, ValueError) as error:
            raise BadFrame(f"a percept cannot be read: {error}") from error

    def send(self, target: dict[str, float], kp: float, kd: float) -> None:
        """Tell joints angles: rad; kp N m/rad, kd N m s/rad.

        A name that the robot does not have ends the server: use those of a percept.
        """
        self.agent.send("".join(
            f"({effector(joint)} {np.rad2deg(angle):.4f} 0.0 {kp:g} {kd:g} 0.0)"
            for joint, angle in target.items()
        ) + "(syn)")  # fmt: skip

    def close(self) -> None:
        """Leave the field."""
        self.agent.close()


def effector(joint: str) -> str:
    """Name of the motor of a joint: "llj1" is moved by "lle1"."""
    head, _, number = joint.rpartition("j")
    return f"{head}e{number}"


def _percept(message: list[Any]) -> Percept:
    """Translate a message."""
    now, angle, velocity = 0.0, {}, {}
    position, quaternion = np.full(3, np.nan), np.full(4, np.nan)
    for kind, *rest in message:
        told = named(rest)
        if kind == "time":
            now = float(told["now"][0])
        elif kind == "HJ":
            joint = told["n"][0].partition("_")[2]
            angle[joint] = float(np.deg2rad(float(told["ax"][0])))
            velocity[joint] = float(np.deg2rad(float(told["vx"][0])))
        elif kind == "pos":
            position = np.array(told["p"], float)
        elif kind == "quat":
            quaternion = np.array(told["q"], float)
    return Percept(now, angle, velocity, position, quaternion)
