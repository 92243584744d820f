"""Standing robots on floors and with loads that their model file does not have."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import mujoco
import numpy as np
import pytest
from test_diagnosis_floor import (
    PERIOD,
    XML,
    commands,
    logged,
    quadruped,
    recorded,
    silent,
)

from gatjax.diagnosis import search
from gatjax.diagnosis.bank import CAUSES, OTHERS
from gatjax.diagnosis.diagnose import diagnose
from gatjax.diagnosis.floor import carried, claims, contact, scene, standing
from gatjax.diagnosis.floor import judge as judges
from gatjax.diagnosis.floor.causes import suspects
from gatjax.diagnosis.floor.judge import StandingJudge
from gatjax.diagnosis.given import Logs
from gatjax.diagnosis.start import Start, read_start
from gatjax.effects import ground
from gatjax.robot.model import load
from gatjax.sim.contact import Law, law_of, with_law
from gatjax.sim.stored import read_world
from gatjax.task import Task


@pytest.fixture(scope="module")
def model() -> mujoco.MjModel:
    return mujoco.MjModel.from_xml_string(XML)


def test_a_floor_that_grips_otherwise_is_no_cause(
    model: mujoco.MjModel, tmp_path: Path
) -> None:
    """Its law is found, and is in everything that a diagnosis writes."""
    (tmp_path / "robot.xml").write_text(XML)
    elliptic = with_law(model, Law("elliptic", 8.0))
    log = recorded(*logged(elliptic, asked=scissors()))
    found = diagnose(
        Start(str(tmp_path / "robot.xml")), Logs([log], [log]), tmp_path / "out", 0,
        silent,
    )  # fmt: skip
    assert (found["verdict"], found["causes"]) == ("none", [])
    (row,) = (row for row in found["data_checks"] if row["check"] == "contact")
    world, _ = read_world(tmp_path / "out", Task(control_period=PERIOD))
    law = law_of(world.model)
    assert law.cone == "elliptic" and 3.0 < law.impratio < 17.0
    assert law_of(load(tmp_path / "out/extended.xml")) == law
    again = read_start(tmp_path / "out")
    assert law_of(again.model()) == law_of(again.world(PERIOD).model) == law
    assert f'<option cone="elliptic" impratio="{law.impratio:g}"/>' in row["text"]
    assert found["gain"]["after"] < 0.6 * found["gain"]["before"]


def scissors() -> tuple[np.ndarray, np.ndarray]:
    """Stamps [N] s and feet that go to and fro in turn [N, 5] rad, with a nod."""
    time, bow = commands()
    swing = 0.04 * np.sin(2.0 * np.pi * 0.9 * time)
    return time, np.stack([bow[:, 0], -swing, swing, swing, -swing], -1)


def test_a_model_keeps_its_law_where_none_is_surely_better(
    model: mujoco.MjModel,
) -> None:
    """Ice is a cause and no law."""
    ice = {"mu": 0.1}
    run, channels = logged(model, "ground_friction", "ground", ice, scissors())
    robot = standing.prepare(model, [run], [channels], PERIOD, silent)
    assert contact.best(robot, silent) == law_of(model)


def test_a_payload_of_a_standing_robot_is_told_by_its_feet(
    model: mujoco.MjModel,
) -> None:
    where = "LHip"
    values = {"mass": 0.5, "x": 0.03, "y": 0.01, "z": 0.05}
    run, channels = logged(model, "payload", where, values)
    robot = standing.prepare(model, [run], [channels], PERIOD, silent)
    best = claims.claims(scene.prepare(robot, silent), silent)[0]
    assert (best.cause, best.where) == ("payload", where)
    assert best.gain > 10.0 and best.low < best.high
    assert best.values["mass"] == pytest.approx(0.5, rel=0.15)
    assert best.values["x"] == pytest.approx(0.03, abs=0.02)


def test_a_payload_stays_near_its_link(model: mujoco.MjModel) -> None:
    first = carried.loads(model)[0]
    assert first.values(np.array([-0.2, 1.0, 1.0, 0.0]))["mass"] == 0.0
    far = first.values(np.array([0.1, 9.0, -9.0, 0.0]))
    assert far["x"] == pytest.approx(first.centre[0] + carried.FARTHEST)
    assert far["y"] == pytest.approx(first.centre[1] - carried.FARTHEST)


def test_joints_of_a_standing_robot_are_looked_at_with_a_part_of_the_bank(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """As `Accepting` asks for where one joint's claim is looked at again."""
    banks = []
    monkeypatch.setattr(search, "proposals", lambda *told: banks.append(told[2]) or [])
    monkeypatch.setattr(judges, "of_drive", lambda joint, bank: (joint, bank))
    judge: Any = SimpleNamespace(
        joints=["hip"], known=["healthy"], apart=lambda joints: False
    )
    for own in ((), (CAUSES,)):
        assert StandingJudge.explained(judge, 0, *own) == []
    assert banks == [("hip", CAUSES + OTHERS), ("hip", CAUSES)]


def test_a_foot_that_is_a_ball_wears_to_all_sides(tmp_path: Path) -> None:
    model = quadruped(tmp_path / "quad.xml", 'type="plane" size="5 5 .1"')
    foot = model.body("l1").id
    params = {name: np.zeros(model.nbody) for name in ("wear", "x", "y")}
    params["wear"][foot], params["y"][foot] = 0.004, 1.0
    fields = ground.wear(model, {}, params)
    (sole,) = np.flatnonzero((model.geom_bodyid == foot) & (model.geom_contype > 0))
    assert fields["geom_pos"][sole] - model.geom_pos[sole] == pytest.approx(
        [0.0, 0.0, 0.004]
    )
    np.testing.assert_array_equal(fields["geom_quat"], model.geom_quat)
    sides = [each for each in suspects(model) if each.cause == "sole_geometry"]
    assert len(sides) == 4  # one for each foot
