"""The grounding folder: written whole, read only if it fits robot and control rate."""

import errno
import json
import os

import numpy as np
import pytest

from gatjax.data.trajectories import JointRun
from gatjax.grounding.envelope import Envelope
from gatjax.grounding.grounder import Experience
from gatjax.grounding.learn import (
    METHODS,
    Grounding,
    grounded,
    read_grounding,
    write_grounding,
)
from gatjax.records import JOINTS
from gatjax.sim.world import nominal
from gatjax.task import task_at


def example(**facts):
    deviation = np.full(len(JOINTS), 0.01, np.float32)
    return Grounding("envelope", Envelope(np.float32(0.5), deviation), facts)


def refusal(folder):
    with pytest.raises(ValueError) as caught:
        read_grounding(folder)
    assert "\n" not in str(caught.value)
    return str(caught.value)


@pytest.mark.parametrize("method", METHODS)
def test_the_shapes_of_every_method_come_back(tmp_path, method):
    write_grounding(
        tmp_path, Grounding(method, METHODS[method].template(13), {"alpha": 0.5})
    )
    assert read_grounding(tmp_path).facts == {"alpha": 0.5}


@pytest.mark.parametrize(
    ("change", "says"),
    [
        ({"schema": "gatjax.grounding/9"}, "schema is 'gatjax.grounding/9', need"),
        ({"joints": "LKneePitch"}, "joints is 'LKneePitch', need a list of names"),
        ({"method": "magic"}, "method 'magic' is unknown"),
        ({"method": None}, "method 'None' is unknown"),
    ],
)
def test_a_grounder_file_of_something_else_is_refused(tmp_path, change, says):
    write_grounding(tmp_path, example())
    path = tmp_path / "grounder.json"
    path.write_text(json.dumps(json.loads(path.read_text()) | change))
    assert says in refusal(tmp_path)


def test_a_grounder_file_that_holds_no_object_is_refused(tmp_path):
    write_grounding(tmp_path, example())
    (tmp_path / "grounder.json").write_text("[]")
    assert "expected {key: value}" in refusal(tmp_path)


@pytest.mark.parametrize(
    ("arrays", "says"),
    [
        ({".alpha": np.float32(1.0)}, "lacks .deviation"),
        ({".deviation": np.zeros(3)}, ".deviation is float64[3], need floats [25]"),
        ({".deviation": np.full(25, np.nan)}, ".deviation is not finite"),
        ({".deviation": np.zeros(25, "U1")}, "need floats"),
    ],
)
def test_weights_that_do_not_fit_are_refused(tmp_path, arrays, says):
    write_grounding(tmp_path, example())
    np.savez(tmp_path / "weights.npz", **{".alpha": np.float32(1.0)} | arrays)
    assert says in refusal(tmp_path)


@pytest.mark.parametrize("content", [b"", b"PK", b"PK\x03\x04" + bytes(50)])
def test_damaged_weights_are_refused(tmp_path, content):
    write_grounding(tmp_path, example())
    (tmp_path / "weights.npz").write_bytes(content)
    assert "no complete grounding" in refusal(tmp_path)


def test_a_changed_byte_in_the_weights_is_refused(tmp_path):
    write_grounding(tmp_path, example())
    raw = bytearray((tmp_path / "weights.npz").read_bytes())
    deviation = np.full(len(JOINTS), 0.01, np.float32).tobytes()
    raw[raw.index(deviation) + 1] ^= 255
    (tmp_path / "weights.npz").write_bytes(raw)
    assert "no complete grounding" in refusal(tmp_path)


def test_a_grounding_is_written_whole_or_not_at_all(tmp_path, monkeypatch):
    write_grounding(tmp_path, example(alpha=0.5))
    before = {path.name: path.read_bytes() for path in tmp_path.iterdir()}

    def full(_):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(OSError, match="nothing was changed"):
        write_grounding(tmp_path, example(alpha=0.9))
    assert {path.name: path.read_bytes() for path in tmp_path.iterdir()} == before


def test_a_grounding_of_another_robot_is_refused():
    with pytest.raises(ValueError, match="nao lacks: elbow, wrist"):
        grounded(nominal(), example()._replace(joints=("elbow", "LKneePitch", "wrist")))


def test_a_grounding_is_used_at_its_own_rate_only(tmp_path):
    write_grounding(tmp_path, example(rate_hz=100.0))
    grounding = read_grounding(tmp_path)
    grounded(nominal(task_at(100.0)), grounding)
    with pytest.raises(ValueError, match="learned at 100 Hz, used at 50 Hz"):
        grounded(nominal(), grounding)
    grounded(nominal(), example())  # one that does not say


@pytest.mark.parametrize("method", ["guided", "sgat"])
def test_a_grounding_of_a_joint_at_rest_can_be_read_again(tmp_path, method):
    time = 0.02 * np.arange(120)
    runs = []
    for number in range(4):
        command = np.stack([0.3 * np.sin(5.0 * time + number), 0.0 * time], 1)
        runs.append(JointRun(number, time, command, 0.8 * np.roll(command, 1, 0)))
    given = Experience(runs, runs, None, None, None, None, 0, print)
    made = Grounding(method, *METHODS[method].learn(given))
    write_grounding(tmp_path, made._replace(joints=("moves", "rests")))
    found = read_grounding(tmp_path).params
    np.testing.assert_array_equal(
        found.forward.input_scale, made.params.forward.input_scale
    )
