"""rcssservermj: percepts by hand; live where GATJAX_RCSSMJ says how to start it."""

import os
import subprocess
import sys
import time
import venv

import numpy as np
import pytest
from simspark_server import Recorded

from gatjax.hardware.frames import BadFrame, Lost
from gatjax.hardware.rcssmj import Player, effector

PERCEPT = (
    "(time (now 0.04))(GS (t 0.0) (pm BeforeKickOff))"
    "(quat (n torso_quat) (q 1.0 0.0 0.0 0.0))(pos (n torso_pos) (p -2.0 0.5 0.66))"
    "(GYR (n torso_gyro) (rt 0.0 0.0 0.0))(HJ (n q_he1) (ax 0.0) (vx 0.0))"
    "(HJ (n q_llj4) (ax 57.29578) (vx -5.729578))"
)


def test_a_percept_by_hand_and_what_is_answered():
    server = Recorded([("<", PERCEPT), ("<", PERCEPT)])
    player = Player("127.0.0.1", server.port)
    percept = player.receive()
    assert percept.angle["llj4"] == pytest.approx(1.0)
    assert percept.velocity["llj4"] == pytest.approx(-0.1)
    np.testing.assert_allclose(percept.position, [-2.0, 0.5, 0.66])
    player.send({"llj4": 1.0}, kp=150.0, kd=6.0)
    player.receive()
    player.close()
    server.close()
    assert server.heard == [
        "(init T1 gatjax 1)",
        "(lle4 57.2958 0.0 150 6 0.0)(syn)",
    ]


@pytest.mark.parametrize("text", ["(GS ((1 2) 3))", "(time (now x))", "(HJ (n a))"])
def test_a_percept_that_cannot_be_read_is_a_bad_frame(text):
    server = Recorded([("<", text)])
    player = Player("127.0.0.1", server.port)
    with pytest.raises(BadFrame, match="a percept cannot be read"):
        player.receive()
    player.close()
    server.close()


def test_names_and_nobody_there():
    assert [effector(joint) for joint in ("hj1", "llj6")] == ["he1", "lle6"]
    with pytest.raises(Lost, match="pip install rcsssmj"):
        Player("127.0.0.1", 1)


@pytest.mark.skipif(
    "GATJAX_RCSSMJ" not in os.environ,
    reason="downloads rcsssmj (150 MB): GATJAX_RCSSMJ=1, or the path of rcssservermj",
)
def test_t1_stands_still_live(tmp_path):
    server = os.environ["GATJAX_RCSSMJ"]
    if server == "1":
        venv.create(tmp_path / "venv", with_pip=True)
        pip = [tmp_path / "venv" / "bin" / "pip", "install", "-q", "rcsssmj==0.2.1"]
        subprocess.run(pip, check=True)
        server = tmp_path / "venv" / "bin" / "rcssservermj"
    ports = ["--host", "127.0.0.1", "--aport", "60123", "--mport", "60124"]
    flags = ["--sync", "--no-realtime", "--no-render"]
    process = subprocess.Popen([server, *ports, *flags], stdout=sys.stderr)
    try:
        stands_still(60123)
    finally:
        process.kill()
        process.wait()


def stands_still(port):
    player = joined(port)
    try:
        first = percept = player.receive()
        assert len(first.angle) == 23
        heights = []
        for _ in range(250):  # 5 s
            player.send(first.angle, kp=150.0, kd=6.0)
            percept = player.receive()
            heights.append(percept.position[2])
    finally:
        player.close()
    assert np.ptp(heights[100:]) < 0.01
    _, x, y, _ = percept.quaternion
    assert 1.0 - 2.0 * (x**2 + y**2) > 0.99  # upright


def joined(port):
    """Join as soon as the server is up."""
    for _ in range(300):
        try:
            return Player("127.0.0.1", port)
        except Lost:
            time.sleep(0.1)
    raise AssertionError("the server did not come up in 30 s")
