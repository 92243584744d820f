"""SimSpark (rcssserver3d), the simulator of the paper: its NAO over TCP.

The server runs in lockstep (`$agentSyncMode = true`). A joint is told a speed; the
position is held here: v = (new target - old target + 0.2 (old target - angle)) / 20 ms.
What its messages look like and which signs its joints have: docs/hardware.md.
"""

from __future__ import annotations

import time
from collections import deque
from typing import Any, NamedTuple

import numpy as np

from gatjax.hardware.agent import Agent, named, parse
from gatjax.hardware.frames import BadFrame, Command, Frame, Lost
from gatjax.hardware.monitor import Monitor
from gatjax.hardware.poses import placed, tilt_below, tilt_of
from gatjax.records import JOINTS, Reading

Array = Any

PERIOD = 0.02  # s
FASTEST = 6.13  # rad/s that a joint is told at most
PULL = 0.2  # share of the error that is made good in a period
PATIENCE = 10.0  # s
SETTLE = 25  # frames in which a new robot falls to the ground
_PARTS = {
    "HeadYaw": ("h", 1, 1), "HeadPitch": ("h", 2, -1),
    "ShoulderPitch": ("a", 1, -1), "ShoulderRoll": ("a", 2, 1),
    "ElbowYaw": ("a", 3, 1), "ElbowRoll": ("a", 4, 1),
    "HipYawPitch": ("l", 1, 1), "HipRoll": ("l", 2, 1), "HipPitch": ("l", 3, -1),
    "KneePitch": ("l", 4, -1), "AnklePitch": ("l", 5, -1), "AnkleRoll": ("l", 6, 1),
}  # fmt: skip
"""Joint of the NAO -> limb, number, sign."""
EFFECTORS = (
    "he1", "he2", *(f"{side}ae{n}" for side in "lr" for n in range(1, 5)),
    *(f"{side}le{n}" for side in "lr" for n in range(1, 7)),
)  # fmt: skip
"""Joints of SimSpark in the order in which they are told."""


class Slot(NamedTuple):
    """Where a joint of SimSpark belongs."""

    joint: int  # in JOINTS
    sign: float


def _slot(effector: str) -> Slot:
    """Find the NAO's joint; both hips turn with LHipYawPitch."""
    head = effector.startswith("h")
    side = "" if head else effector[0].upper()
    limb, number = ("h" if head else effector[1]), int(effector[-1])
    for name, (part, count, sign) in _PARTS.items():
        if (part, count) == (limb, number):
            joint = side + name if not head else name
            joint = "LHipYawPitch" if name == "HipYawPitch" else joint
            return Slot(JOINTS.index(joint), float(sign))
    raise ValueError(effector)


SLOTS = tuple(_slot(effector) for effector in EFFECTORS)
JOINT, SIGN = np.array([s.joint for s in SLOTS]), np.array([s.sign for s in SLOTS])
MISSING = np.setdiff1d(np.arange(len(JOINTS)), JOINT)  # wrists and hands
SENSED = {name.replace("e", "j"): place for place, name in enumerate(EFFECTORS)}
"""What a joint is called where it is sensed ("hj1" of "he1") -> its place there."""
FOLLOWER = EFFECTORS.index("rle1")  # of two hips that turn together the left one counts
FRONT, REAR, OUTER, INNER = 0.0703, -0.03, 0.0299, -0.0211  # m, foot sensors [URDF]


class Type(NamedTuple):
    """A robot of SimSpark."""

    scene: str
    start: tuple[float, float]  # m, in its own half, with room ahead
    stiffness: bool  # it can be told


TYPES = {
    "simspark": Type("(scene rsg/agent/nao/nao.rsg 0)", (-12.0, 0.0), False),
    "simspark-v4": Type("(scene rsg/agent/naov4/nao.rsg)", (-4.0, 0.0), True),
}
AVERAGED = 10  # frames, over which what an accelerometer says is up is taken
HINT = (
    "start rcssserver3d with $agentSyncMode = true, or name another server: "
    "--robot simspark:HOST:PORT:MONITORPORT, or GATJAX_SIMSPARK"
)


class SimSpark:
    """A NAO in SimSpark; a `frames.Link`."""

    period = PERIOD
    realtime = False
    clocked = True
    thinking = 20.0
    hint = HINT

    def __init__(
        self, name: str, host: str, port: int, monitor: int | None = None, *,
        scene: str | None = None,
    ) -> None:  # fmt: skip
        """Connect and put a robot on the field.

        Args:
            name: a key of TYPES.
            host: of the server.
            port: of agents.
            monitor: port of monitors; tells where a robot is that has no GPS.
            scene: message that makes the robot, where it is not the usual one.

        Raises:
            Lost: one line: nobody is there, or does not answer.
        """
        self.name = self.identity = name
        self.type = TYPES[name]
        self.scene = scene or self.type.scene
        self.where = (host, port)
        self.monitor: Monitor | None = None
        self.agent = self._join()
        if monitor is not None:
            self.monitor = Monitor(host, monitor)

    def _join(self) -> Agent:
        """Make a robot and beam it to its start."""
        agent = Agent(*self.where, HINT)
        x, y = self.type.start
        for text in (
            self.scene, "(init (unum 1)(teamname gat))", "", f"(beam {x:g} {y:g} 0)",
        ):  # fmt: skip
            agent.send(text + "(syn)")
            self._waiting = agent.receive(PATIENCE)
            if self._waiting is None:
                agent.close()
                what = text or "(syn)"
                raise Lost(f"{agent.place}: no answer to {what} for {PATIENCE:g} s")
        self._angle = np.zeros(len(JOINTS))  # of joints that SimSpark does not have
        self._told = np.zeros(len(EFFECTORS))  # rad, in SimSpark's signs
        self._sensed = np.zeros(len(EFFECTORS))
        self._first = True
        self._temperature = np.full(len(JOINTS), 25.0)
        self._battery = 1.0
        self._pulls: deque[np.ndarray] = deque(maxlen=AVERAGED)
        return agent

    def place(self) -> bool:
        """Make the robot anew, at its start, and let it come to the ground."""
        self.agent.close()
        self.agent = self._join()
        start: Array | None = None
        for _ in range(SETTLE):
            if self.receive(PATIENCE) is None:
                raise Lost(f"{self.name}: silent for {PATIENCE:g} s")
            start = self._angle.copy() if start is None else start
            self.send(Command(start, np.ones(len(JOINTS))))
        return True

    def receive(self, timeout: float) -> Frame | None:
        """Return the next frame; see `frames.Link`."""
        text, self._waiting = self._waiting, None
        text = self.agent.receive(timeout) if text is None else text
        if text is None:
            return None
        received = time.monotonic()
        try:
            return self._frame(parse(text), received)
        except (KeyError, IndexError, ValueError, TypeError) as error:
            raise BadFrame(f"a message cannot be read: {error}") from error

    def _frame(self, message: list[Any], received: float) -> Frame:
        """Translate a message."""
        now, base = 0.0, None
        gyro, pull, force = np.zeros(3), np.zeros(3), np.zeros(8)
        for kind, *rest in message:
            told = named(rest)
            if kind == "time":
                now = float(told["now"][0])
            elif kind == "HJ":
                self._joint(told)
            elif kind == "GYR":
                gyro = np.deg2rad(_turned(told["rt"]))
            elif kind == "ACC":
                pull = _turned(told["a"])
            elif kind == "FRP":
                side = 0 if told["n"][0] == "lf" else 4
                force[side : side + 4] = shared(told["c"], told["f"], side == 0)
            elif kind == "GPS" and told["n"][0] == "torso":
                base = placed(np.array(told["tf"], float).reshape(4, 4))
            elif kind == "BAT":
                self._battery = float(rest[0])
        if base is None and self.monitor is not None:
            base = self.monitor.base()
        self._pulls.append(pull)
        tilt = tilt_below(np.mean(self._pulls, axis=0))
        if base is not None:
            tilt = tilt_of(base.quaternion)
        return Frame(
            time=now, received=received,
            reading=Reading(self._angle.copy(), gyro, pull, force), tilt=tilt,
            stiffness=np.ones(len(JOINTS)), temperature=self._temperature.copy(),
            current=np.zeros(len(JOINTS)), heat=np.zeros(len(JOINTS)),
            battery=self._battery, chest=False, base=base,
        )  # fmt: skip

    def _joint(self, told: dict[str, list[Any]]) -> None:
        """Take what a joint says."""
        place, angle = SENSED[told["n"][0]], np.deg2rad(float(told["ax"][0]))
        self._sensed[place] = angle
        if place == FOLLOWER:
            return
        self._angle[JOINT[place]] = SIGN[place] * angle
        if "tp" in told:
            self._temperature[JOINT[place]] = float(told["tp"][0])

    def send(self, command: Command) -> None:
        """Answer the last frame; see `frames.Link`."""
        target = SIGN * command.target[JOINT]
        old = target if self._first else self._told
        speed = (target - old + PULL * (old - self._sensed)) / PERIOD
        speed = np.clip(speed, -FASTEST, FASTEST)
        power = command.stiffness[JOINT]
        if not self.type.stiffness:
            speed = np.where(power > 0.0, speed, 0.0)
        parts = [f"({name} {value:.3f})" for name, value in zip(EFFECTORS, speed)]
        if self.type.stiffness:
            parts += [f"({name}s {share:.2f})" for name, share in zip(EFFECTORS, power)]
        self.agent.send("".join(parts) + "(syn)")
        self._told, self._first = target, False
        self._angle[MISSING] = command.target[MISSING]

    def close(self) -> None:
        """Leave the field."""
        self.agent.close()
        if self.monitor is not None:
            self.monitor.close()


def _turned(words: list[str]) -> Array:
    """Turn a vector of SimSpark (right, forward, up) into forward, left, up."""
    x, y, z = (float(word) for word in words)
    return np.array([y, -x, z])


def shared(centre: list[str], force: list[str], left: bool) -> Array:
    """Share the force on a foot among its four sensors, so that its centre is right.

    Args:
        centre: of the force, m: right, forward, up, from the middle of the foot.
        force: N, in the same axes.
        left: it is the left foot.

    Returns:
        [4] N: front left, front right, rear left, rear right.
    """
    right, forward = float(centre[0]), float(centre[1])
    up = max(float(force[2]), 0.0)
    outer, inner = (OUTER, INNER) if left else (-INNER, -OUTER)
    ahead = np.clip((forward - REAR) / (FRONT - REAR), 0.0, 1.0)
    aside = np.clip((-right - inner) / (outer - inner), 0.0, 1.0)
    return up * np.outer([ahead, 1.0 - ahead], [aside, 1.0 - aside]).ravel()
