"""A SimSpark server that plays a recorded transcript to whoever connects."""

from __future__ import annotations

import contextlib
import gzip
import math
import socket
import sys
import threading

import mujoco
import numpy as np

from gatjax.hardware.agent import parse
from gatjax.hardware.simspark import (
    EFFECTORS,
    FRONT,
    INNER,
    OUTER,
    PERIOD,
    REAR,
    SLOTS,
)
from gatjax.records import JOINTS
from gatjax.robot.model import load, slots


def lines(path):
    """Messages of a transcript: (">" or "<", text)."""
    with gzip.open(path, "rt") as file:
        return [(line[0], line[2:].rstrip("\n")) for line in file]


class Recorded:
    """Plays the server's messages, one for each of the client's."""

    def __init__(self, messages, port=0):
        self.messages, self.heard = messages, []
        self.socket = socket.create_server(("127.0.0.1", port))
        self.port = self.socket.getsockname()[1]
        self.thread = threading.Thread(target=self._play, daemon=True)
        self.thread.start()

    def _play(self):
        while True:
            try:
                client, _ = self.socket.accept()
            except OSError:
                return
            with client, client.makefile("rb") as stream, contextlib.suppress(OSError):
                self._serve(client, stream)

    def _serve(self, client, stream):
        for _, text in (m for m in self.messages if m[0] == "<"):
            head = stream.read(4)
            if len(head) < 4:
                return
            told = stream.read(int.from_bytes(head, "big"))
            self.heard.append(told.decode())
            message = text.encode()
            client.sendall(len(message).to_bytes(4, "big") + message)

    def close(self):
        self.socket.close()


class Kinematic(Recorded):
    """A robot that does with its joints what it is told and never falls."""

    def __init__(self, port=0):
        self.angle = dict.fromkeys(EFFECTORS, 0.0)  # degrees
        self.now = 100.0
        super().__init__([], port)

    def _serve(self, client, stream):
        told = b""
        while len(head := stream.read(4)) == 4:
            told = stream.read(int.from_bytes(head, "big")).decode()
            self.heard.append(told)
            self._hear(told)
            self.now += PERIOD
            message = self._percept().encode()
            client.sendall(len(message).to_bytes(4, "big") + message)

    def _hear(self, told):
        for kind, *values in parse(told):
            if kind in self.angle:
                self.angle[kind] += math.degrees(float(values[0])) * PERIOD

    def _percept(self):
        pose = np.eye(4)
        pose[:3, 3] = -12.0, 0.0, 0.38
        turn = np.array([math.sin(self.now), 0.0, 0.0])
        pull = np.array([math.cos(self.now), 0.0, 9.81])
        feet = "".join(f"(FRP (n {n}) (c 0 0 0) (f 0 0 22.5))" for n in ("lf", "rf"))
        return percept(self.now, pose, turn, pull, self.angle.values()) + feet


class Walking(Kinematic):
    """MuJoCo's NAO behind SimSpark's messages, made anew where it is beamed to.

    As in SimSpark a joint has the speed that it was told at once, a cycle late.
    """

    def __init__(self, port=0):
        self.model = model = load("nao")
        strong = 5.0 * model.actuator_gainprm[:, 0]  # N m/rad: it goes where it is told
        model.actuator_gainprm[:, 0], model.actuator_biasprm[:, 1] = strong, -strong
        model.actuator_biasprm[:, 2] = -0.03 * strong
        model.actuator_forcerange[:] *= 5.0
        self.slots = slots(model)
        self.steps = round(PERIOD / model.opt.timestep)
        self._stand()
        super().__init__(port)

    def _stand(self):
        """Put it on its feet, joints at zero."""
        self.data = mujoco.MjData(self.model)
        self.told = np.zeros(len(JOINTS))  # rad/s
        self.data.ctrl = self.data.qpos[self.slots.position]

    def _hear(self, told):
        before = self.told.copy()
        for kind, *values in parse(told):
            if kind == "scene":
                self._stand()
            elif kind in EFFECTORS and kind != "rle1":  # hips turn with the left one
                slot = SLOTS[EFFECTORS.index(kind)]
                self.told[slot.joint] = slot.sign * float(values[0])
        for _ in range(self.steps):
            self.data.ctrl += before * self.model.opt.timestep
            mujoco.mj_step(self.model, self.data)

    def _percept(self):
        data, slots = self.data, self.slots
        angle, force = data.qpos[slots.position], data.sensordata[slots.force]
        turn = np.rad2deg(data.sensordata[slots.gyro])
        pull = data.sensordata[slots.accelerometer]
        pose = np.eye(4)
        pose[:3, 3] = data.qpos[:3] - [4.0, 0.0, 0.0]
        pose[:3, :3] = data.body("torso").xmat.reshape(3, 3)
        angles = np.rad2deg([s.sign * angle[s.joint] for s in SLOTS])
        feet = foot("lf", force[:4], True) + foot("rf", force[4:], False)
        return percept(self.now, pose, turn, pull, angles) + feet


def percept(now, pose, turn, pull, angles):
    """What SimSpark says but for feet: deg/s and m/s^2 forward, left, up; degrees."""
    place = " ".join(f"{number:.5f}" for number in pose.ravel())
    joints = "".join(
        f"(HJ (n {name.replace('e', 'j')}) (ax {angle:.3f}))"
        for name, angle in zip(EFFECTORS, angles, strict=True)
    )
    return (
        f"(time (now {now:.3f}))(GPS (n torso) (tf {place}))"
        f"(GYR (n torso) (rt {-turn[1]:.3f} {turn[0]:.3f} {turn[2]:.3f}))"
        f"(ACC (n torso) (a {-pull[1]:.3f} {pull[0]:.3f} {pull[2]:.3f})){joints}"
    )


def foot(name, force, left):
    """What SimSpark says of a foot whose four sensors feel `force` [4] N."""
    force = np.maximum(force, 0.0)
    if force.sum() < 0.01:
        return ""  # in the air it says nothing
    outer, inner = (OUTER, INNER) if left else (-INNER, -OUTER)
    share = force.reshape(2, 2) / force.sum()
    forward = share.sum(1) @ [FRONT, REAR]
    right = -share.sum(0) @ [outer, inner]
    centre = f"(c {right:.4f} {forward:.4f} -0.02)"
    return f"(FRP (n {name}) {centre} (f 0 0 {force.sum():.2f}))"


if __name__ == "__main__":  # python tests/simspark_server.py 3100
    Walking(int(sys.argv[1])).thread.join()
