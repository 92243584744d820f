"""A diagnosis that starts from a world: what is known besides the model.

That known causes move a joint as the World does is in test_diagnosis_world.py.
"""

import json

import numpy as np
import pytest

import gatjax.surrogate.hidden
from gatjax.data.recording import Recording
from gatjax.diagnosis.bank import CAUSES, of_drive
from gatjax.diagnosis.case import held, unfitted
from gatjax.diagnosis.diagnose import Logs, diagnose, given
from gatjax.diagnosis.start import ADDING, Start, known, numbers
from gatjax.diagnosis.tolerances import USUAL
from gatjax.effects.catalogue import CATALOGUE
from gatjax.sim.replay import replay_many
from gatjax.sim.world import add_cause, nominal, stacked, write_world
from gatjax.task import Task

ARM = f"{gatjax.surrogate.hidden.__path__[0]}/arm_servo.xml"
PERIOD = 0.02
DELAY, LAG = {"delay": 0.03}, {"time_constant": 0.05}


def written(path, *causes):
    """A world file with some causes at the servo."""
    world = nominal(Task(control_period=PERIOD), ARM)
    for name, values in causes:
        world = add_cause(world, name, ["servo"], values)
    write_world(path, world, {}, None)
    return world


def logged(world, name, seed):
    """A log of the world's servo, with reading noise of 0.5 mrad."""
    draw = np.random.default_rng(seed)
    time = PERIOD * np.arange(500)
    command = 0.4 * np.sin(2.0 * np.pi * (0.3 + 0.1 * time) * time)
    command += 0.3 * np.repeat(draw.uniform(-1.0, 1.0, 10), 50)
    command[:30] = command[30]
    played = replay_many(
        world, stacked([world.values]), command[:, None], np.zeros(1), np.zeros(1)
    )
    angle = played.reading.angle[0] + 5e-4 * draw.normal(size=(500, 1))
    columns = {"command.servo": command, "position.servo": angle[:, 0]}
    metadata = {"robot": "arm", "base": "fixed"}
    return Recording(name, time, np.zeros(500, int), columns, metadata)


def test_causes_of_a_world_are_taken_for_known(tmp_path):
    written(tmp_path / "w.json", ("command_delay", DELAY), ("gain_error", 0.8),
            ("first_order_lag", LAG), ("command_delay", DELAY))  # fmt: skip
    start = known(tmp_path / "w.json")
    model = start.model()
    (assumed,) = start.joints(model)
    assert assumed.numbers == {"delay": 0.06, "lag": 0.05}
    assert assumed.causes == {"first_order_lag"} and not assumed.geared
    plain = Start(ARM).model()
    ratio = model.actuator_gainprm[0, 0] / plain.actuator_gainprm[0, 0]
    assert ratio == pytest.approx(0.8)


def test_what_does_not_add_up_is_not_looked_for_again(tmp_path):
    world = written(tmp_path / "w.json", ("first_order_lag", LAG))
    start = known(tmp_path / "w.json")
    log = logged(world, "log", 0)
    case = given(start, Logs([log], []), 0)
    base = held(case.model, case.logs, 0, assumed=start.joints(case.model))
    (joint,) = unfitted(base, case.logs).joints
    names = {each.cause for each in of_drive(joint, CAUSES)}
    assert names == {each.cause for each in CAUSES} - {"first_order_lag"}


@pytest.mark.parametrize("name", sorted(CATALOGUE))
def test_every_cause_adds_up_changes_the_joint_or_is_refused(name, tmp_path):
    entry = CATALOGUE[name]
    values = {each.name: each.default for each in entry.parameters}
    values |= {entry.main.name: 0.5}
    set_ = numbers(name, values, 2.0, 8.0)
    if entry.place in ("imu", "ground", "foot") or name in (
        "dropped_commands",
        "command_noise",
    ):
        assert not set_
        text = {
            "schema": "gatjax.world/1", "model": "nao",
            "effects": [{"cause": name, "where": ["all"], "values": values}],
        }  # fmt: skip
        (tmp_path / "w.json").write_text(json.dumps(text))
        with pytest.raises(ValueError, match=f"{name}"):
            known(tmp_path / "w.json")
    else:
        assert set_ or name in ADDING
        assert all(np.isfinite(list(set_.values())))


def test_only_what_is_wrong_besides_is_named(tmp_path):
    world = written(tmp_path / "w.json", ("first_order_lag", LAG))
    both = add_cause(world, "gain_error", ["servo"], 0.5)
    logs = Logs([logged(both, "fit", 1)], [logged(both, "held", 2)])
    found = diagnose(
        known(tmp_path / "w.json"), logs, tmp_path / "out", 0, lambda stage, share: None
    )
    (cause,) = found["causes"]
    assert cause["cause"] == "gain_error"
    assert cause["parameters"]["scale"]["value"] == pytest.approx(0.5, rel=0.1)
    rows = json.loads((tmp_path / "out" / "world.json").read_text())["effects"]
    assert [row["cause"] for row in rows[:2]] == ["first_order_lag", "gain_error"]
    assert found["made_by"]["known"] == 1


def test_how_close_is_close_enough_is_said_like_a_noise(tmp_path):
    log = logged(written(tmp_path / "w.json"), "log", 0)
    case = given(Start(ARM), Logs([log], []), 0)
    tight, wide = (
        unfitted(held(case.model, case.logs, 0, allowed), case.logs).joints[0].noise
        for allowed in (USUAL, USUAL._replace(angle=0.01))
    )
    assert tight < 1e-3
    assert wide == pytest.approx(np.hypot(tight, 0.01))
