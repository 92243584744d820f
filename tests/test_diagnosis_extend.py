"""A verdict as a world and as plain MJCF: nothing is clipped, lost or added."""

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import mujoco
import numpy as np
import pytest

from gatjax.data.trajectories import JointRun
from gatjax.diagnosis import measure
from gatjax.diagnosis.bank import CAUSES
from gatjax.diagnosis.claims import Claim
from gatjax.diagnosis.extend import (
    calibration,
    claimed,
    effects,
    extended,
    neutral,
    parameters,
    world_values,
)
from gatjax.diagnosis.fit import Fit
from gatjax.diagnosis.hypotheses import COUNT, TOLERANCES, Hypothesis
from gatjax.diagnosis.joint import GRAVITY, Joint, Link
from gatjax.diagnosis.judge import Judge
from gatjax.diagnosis.mjcf import lacking, write_model
from gatjax.diagnosis.verdict import Cause, Verdict
from gatjax.effects.catalogue import CATALOGUE
from gatjax.effects.cause import check_range, complete
from gatjax.robot import model as robot_model
from gatjax.sim.world import World, add_cause, fields_applied, nominal
from gatjax.task import Task

ARM = """
<mujoco>
  <compiler meshdir="assets" {compiler}/>
  <option timestep="0.002" iterations="4"/>
  <asset><mesh name="wedge" file="wedge.obj"/></asset>
  <worldbody>
    <body pos="0 0 1">
      <joint name="lift" axis="0 1 0" damping="0.1" frictionloss="0.02"/>
      <geom type="mesh" mesh="wedge" euler="10 20 30"/>
      <geom type="capsule" fromto="0 0 0 0.2 0 0.1" size="0.02"/>
      <body pos="0.2 0 0.1" euler="0 30 0">
        <joint name="turn" axis="1 0 0"/>
        <inertial pos="0.02 0 0.05" mass="0.4"
          fullinertia="4e-4 5e-4 6e-4 5e-5 0 2e-5"/>
        <geom type="box" size="0.05 0.02 0.03"/>
        <body pos="0 0 0.1">
          <joint name="nod" axis="0 1 0"/>
          <geom type="box" size="0.02 0.02 0.1"/>
        </body>
      </body>
    </body>
  </worldbody>
  <actuator>
    <position joint="lift" kp="20" dampratio="1" forcerange="-6 6"/>
    <position joint="turn" kp="8" kv="0.2"/>
    <position joint="nod" kp="8" kv="0.2" forcelimited="false"/>
  </actuator>
</mujoco>
"""
WEDGE = """
v 0 0 0
v 0.1 0 0
v 0 0.05 0
v 0 0 0.15
f 1 3 2
f 1 2 4
f 1 4 3
f 2 3 4
"""


def arm(folder: Path, compiler: str = "") -> World:
    """Masses from geoms and a mesh; two of three servos without a limit."""
    (folder / "robot" / "assets").mkdir(parents=True)
    (folder / "robot" / "assets" / "wedge.obj").write_text(WEDGE)
    file = folder / "robot" / "arm.xml"
    file.write_text(ARM.format(compiler=compiler))
    return nominal(Task(control_period=0.01), file, 5e-4)


def written(folder: Path, world: World) -> mujoco.MjModel:
    """The model that another folder's extended.xml describes."""
    (folder / "found").mkdir()
    write_model(folder / "found" / "extended.xml", world)
    return robot_model.load(folder / "found" / "extended.xml")


@pytest.mark.parametrize("compiler", ["", 'inertiafromgeom="true"'])
def test_a_written_model_is_the_extended_world(tmp_path: Path, compiler: str) -> None:
    """It loads from another folder, and has every field that the world changes."""
    world = arm(tmp_path, compiler)
    for name, where, values in (
        ("payload", "lift", {"mass": 0.3, "x": 0.1, "y": 0.02, "z": 0.05}),
        ("com_shift", "turn", {"x": 0.01, "z": -0.02}),
        ("coulomb_friction", "turn", {"torque": 0.2}),
        ("viscous_friction", "lift", {"coefficient": 0.3}),
        ("armature", "nod", {"inertia": 0.004}),
        ("gain_error", "lift", {"scale": 0.7}),
        ("damping_error", "turn", {"scale": 2.0}),
        ("torque_limit", "nod", {"limit": 1.5}),
        ("gravity_tilt", "all", {"roll": 0.1, "pitch": -0.05}),
    ):
        world = add_cause(world, name, [where], values)
    found, expected = written(tmp_path, world), fields_applied(world)
    for name in (*world.values.body, "opt.iterations", "opt.ls_iterations"):
        owners = [m.opt if "." in name else m for m in (found, expected)]
        ours, theirs = (getattr(o, name.removeprefix("opt.")) for o in owners)
        np.testing.assert_allclose(ours, theirs, rtol=2e-4, atol=1e-6, err_msg=name)
    assert np.isinf(found.actuator_forcerange[1]).all()
    assert (tmp_path / "found" / "extended.xml").read_text().count("forcerange") == 2


def test_a_joint_with_backlash_keeps_its_servo(tmp_path: Path) -> None:
    """Plain MJCF has no gear: the file says nothing of it, and is told to."""
    world = add_cause(arm(tmp_path), "backlash", ["lift"], 0.02)
    found, plain = written(tmp_path, world), arm(tmp_path / "again").model
    for name in ("actuator_gainprm", "actuator_biasprm", "dof_armature", "dof_damping"):
        np.testing.assert_allclose(
            getattr(found, name), getattr(plain, name), rtol=1e-5, err_msg=name
        )
    write_model(tmp_path / "extended.xml", world)
    told = lacking(world)
    assert told == ["backlash at lift: width 0.02 rad"]


def test_a_late_command_is_a_delay_of_the_c_engine(tmp_path: Path) -> None:
    """It comes into force in the first step after it; the file says what to mind."""
    world = add_cause(arm(tmp_path), "command_delay", ["lift"], 0.0113)
    world = add_cause(world, "command_delay", ["all"], 0.003, "calibration")
    world = add_cause(world, "dead_band", ["turn"], 0.01)
    model = written(tmp_path, world)
    np.testing.assert_allclose(model.actuator_delay, [0.0143, 0.003, 0.003])
    data, seen = mujoco.MjData(model), []
    data.ctrl[0] = 0.1
    for _ in range(10):
        mujoco.mj_step(model, data)
        seen.append(data.actuator_force[0] > 1.0)
    assert seen.index(True) == 8  # 16 ms
    remarks = (tmp_path / "found" / "extended.xml").read_text().split("-->")
    assert [line.split("<!-- ")[-1][:26] for line in remarks[1:-1]] == [
        "has cause command_delay at", "has calibration command_de",
        "lacks dead_band at turn: h", "delays are of MuJoCo C, in",
    ]  # fmt: skip
    assert lacking(world) == ["dead_band at turn: half_width 0.01 rad"]
    for values in ({"offset": 0.02}, {"offset": 0.01, "in_loop": 1.0}):
        world = add_cause(world, "encoder_offset", ["turn"], values)
    assert lacking(world)[1:] == [
        "encoder_offset at turn: offset 0.02 rad",
        "encoder_offset at turn: offset 0.01 rad; the servo sees it too",
    ]


def test_a_delay_below_half_a_physics_step_is_not_in_the_model(tmp_path: Path) -> None:
    """The file's step is 2 ms; two short delays of one joint count together."""
    world = add_cause(arm(tmp_path), "command_delay", ["lift"], 0.0008, "calibration")
    assert written(tmp_path, world).actuator_delay.max() == 0.0
    assert lacking(world) == ["command_delay at lift: delay 0.0008 s"]
    assert "has" not in (tmp_path / "found" / "extended.xml").read_text()
    more = add_cause(world, "command_delay", ["all"], 0.0006)
    write_model(tmp_path / "more.xml", more)
    late = robot_model.load(tmp_path / "more.xml").actuator_delay
    np.testing.assert_allclose(late, [0.0014, 0.0, 0.0])
    assert lacking(more) == []


CORRECTED = {
    "armature": 0.002, "command_delay": 0.004, "coulomb_friction": 0.03,
    "damping_error": 0.8, "encoder_offset": 0.02, "gain_error": 1.1,
    "torque_limit": 2.0, "viscous_friction": 0.05,
}  # fmt: skip


@pytest.mark.parametrize("cause", ["stiction", "backlash", "command_delay"])
def test_neutral_calibration_changes_nothing_in_the_same_batch(tmp_path, cause):
    values = {CATALOGUE[cause].main.name: 0.05}
    world = add_cause(arm(tmp_path), cause, ["lift"], values)
    rows = [
        {"cause": name, "where": [joint], "role": "calibration",
         "values": {CATALOGUE[name].main.name: value}}
        for name, value in CORRECTED.items() for joint in ("lift", "turn")
    ]  # fmt: skip
    pair = [world, world]
    for k, some in enumerate((neutral(rows), rows)):
        for row in some:
            place = row["cause"], row["where"], row["values"], row["role"]
            pair[k] = add_cause(pair[k], *place)
    time = 0.01 * np.arange(100)
    command = 0.6 * np.sin(5.0 * time)[:, None] * np.ones(3)
    run = JointRun(0, time, command, 0.0 * command)
    both = measure.whole_log(pair[0], [run, run], [each.values for each in pair])
    (plain,), (corrected,) = (measure.whole_log(w, [run]) for w in (world, pair[1]))
    np.testing.assert_allclose(both[0], plain, atol=1e-9)
    np.testing.assert_allclose(both[1], corrected, atol=1e-9)
    assert np.abs(corrected - plain)[:, :2].max(0).min() > 0.01


FEET = """
<mujoco>
  <compiler meshdir="assets"/>
  <asset><mesh name="wedge" file="wedge.obj" inertia="convex"/></asset>
  <worldbody>
    <geom type="plane" size="1 1 1"/>
    <body pos="0 0 1">
      <freejoint/>
      <geom type="box" size="0.1 0.1 0.1"/>
      <body name="box" pos="0 0.1 -0.3"><joint name="a" axis="0 1 0"/>
        <geom type="box" size="0.08 0.04 0.01" euler="0 5 20"/></body>
      <body name="rails" pos="0 -0.1 -0.3"><joint name="b" axis="0 1 0"/>
        <geom type="capsule" fromto="0.05 -0.04 0 0.05 0.04 0" size="0.01"/>
        <geom type="capsule" fromto="-0.05 -0.04 0 -0.05 0.04 0" size="0.01"/></body>
      <body name="cast" pos="0 0 -0.3"><joint name="c" axis="0 1 0"/>
        <geom type="mesh" mesh="wedge" axisangle="0 1 0 40" pos="0.01 0 0.02"/></body>
    </body>
  </worldbody>
  <actuator>
    <position joint="a" kp="20"/><position joint="b" kp="20"/>
    <position joint="c" kp="20"/>
  </actuator>
</mujoco>
"""


@pytest.mark.parametrize("foot", ["box", "rails", "cast"])
def test_a_worn_sole_is_written_whatever_its_shape(tmp_path: Path, foot: str) -> None:
    """Angles, ends of a rail, and the frame of a mesh are not where MuJoCo has them."""
    arm(tmp_path)
    file = tmp_path / "robot" / "feet.xml"
    file.write_text(FEET)
    world = nominal(Task(control_period=0.01), file)
    world = add_cause(world, "sole_geometry", [foot], {"wear": 0.004})
    found, expected = written(tmp_path, world), fields_applied(world)
    for name in ("geom_pos", "geom_quat"):
        ours, theirs = getattr(found, name), getattr(expected, name)
        assert (
            np.abs(theirs - getattr(world.model, name)).max() > 1e-4 or foot == "rails"
        )
        np.testing.assert_allclose(ours, theirs, atol=1e-6, err_msg=name)


STRONG = {
    "limit": 9e5, "kp": 1e5, "kv": 1e4, "damping": 500.0, "friction": 200.0,
    "armature": 50.0, "hold": 1.0, "give": 3e-4, "delay": 0.001, "creep": 0.06,
}  # fmt: skip
WEAK = {
    "limit": 0.01, "kp": 0.02, "kv": 1e-4, "damping": 1e-4, "friction": 1e-3,
    "armature": 1e-6, "hold": 1.0, "give": 3e-4, "delay": 0.001, "creep": 0.06,
}  # fmt: skip


class Warm(Joint):
    """A joint whose motor gets as warm as its limit does in 100 s."""

    def outcome(self, drives: list, geared: bool) -> Any:
        """What is read of a simulation."""
        return SimpleNamespace(heat=np.array([100.0]))


def judged(numbers: dict[str, float]) -> Judge:
    """What `world_values` reads of a judge of one joint."""
    gravity = dict(zip(GRAVITY, (0.0, 0.0, -9.81), strict=True))
    none: Any = None
    grid: Any = SimpleNamespace(inertia=np.full((1, 1), 18.0 * numbers["armature"]))
    joint = Warm(
        "joint", 0, numbers | gravity, grid, 0, none, none, none, 1e-4,
        link=Link(200.0, np.array([1.5, 0.0, -1.5]), np.eye(3)[0]),
    )  # fmt: skip
    judge: Any = object.__new__(Judge)
    model = mujoco.MjModel.from_xml_string(
        """<mujoco><worldbody><body><joint name="joint" damping="{damping}"
        frictionloss="{friction}" armature="{armature}"/><geom size="1"/></body>
        </worldbody><actuator><motor joint="joint"/></actuator></mujoco>
        """.format(**numbers)
    )
    case = SimpleNamespace(supply=numbers["limit"], model=model)
    judge.joints, judge.case = [joint], case
    return judge


def start_fit(hypothesis: Hypothesis, own: Any) -> Fit:
    """A fit with nominal tolerances."""
    x = np.append(np.zeros(COUNT), own)
    slopes, square = np.zeros((0, len(x))), np.eye(len(x))
    return Fit(hypothesis, x, 0.0, np.zeros(0), slopes, square, 1.0, True)


@pytest.mark.parametrize(
    "judge", [judged(STRONG), judged(WEAK)], ids=["strong", "weak"]
)
@pytest.mark.parametrize("hypothesis", CAUSES, ids=lambda h: h.name)
def test_the_world_takes_all_that_the_search_can_find(
    hypothesis: Hypothesis, judge: Judge
) -> None:
    """As it is, of a finger as of a robot that lifts cars."""
    entry = CATALOGUE[hypothesis.cause]
    for own in (hypothesis.low, *hypothesis.starts, hypothesis.high):
        fit = start_fit(hypothesis, own)
        claim = Claim(hypothesis, np.array(own), (0,), {0: fit}, 0.0)
        values, found = world_values(judge, claim), parameters(judge, claim)
        check_range(hypothesis.cause, entry, complete(hypothesis.cause, entry, values))
        if "no_torque_speed" not in found:
            assert values == values | found


def test_a_shared_share_is_another_torque_at_a_weaker_joint() -> None:
    """Friction of a tenth of each limit: what each joint was fitted with."""
    [hypothesis] = [h for h in CAUSES if h.law == ("coulomb_friction", "")]
    [lag] = [h for h in CAUSES if h.cause == "first_order_lag"]
    judge = judged(STRONG)
    strong = judge.joints[0]
    weak = strong._replace(
        name="wrist", index=1, nominal=judged(WEAK).joints[0].nominal
    )
    judge.joints = [strong, weak, strong._replace(name="other", index=2)]
    own = np.log(np.array([0.1]))
    found = effects(judge, Claim(hypothesis, own, (0, 1, 2), {}, 0.0))
    assert [where for _, where, _ in found] == [["joint", "other"], ["wrist"]]
    for (_, _, values), joint in zip(found, judge.joints, strict=False):
        drive: dict[str, float] = {}
        hypothesis.put(drive, joint, own)
        assert values["torque"] == pytest.approx(drive["friction"])
    shared = effects(judge, Claim(lag, own, (0, 1, 2), {}, 0.0))
    assert [where for _, where, _ in shared] == [["all"]]


def test_no_more_is_taken_from_a_joint_than_it_has_itself() -> None:
    """Friction of joints that are tied to it is in its nominal number, too."""
    [less] = [h for h in CAUSES if h.law == ("coulomb_friction", "less than nominal")]
    judge = judged(STRONG)
    (joint,) = judge.joints
    own = float(judge.case.model.dof_frictionloss[0])
    tied = joint.nominal | {"friction": 3.0 * own}
    judge.joints = [joint._replace(nominal=tied)]
    claim = Claim(less, np.log(np.array([0.1])), (0,), {}, 0.0)
    assert parameters(judge, claim)["torque"] == pytest.approx(-2.7 * own)
    assert world_values(judge, claim)["torque"] == pytest.approx(-own)


@pytest.mark.parametrize(("most", "kept"), [(0.3, 3), (0.2, 0)])
def test_corrections_of_a_joint_are_kept_together(most: float, kept: int) -> None:
    """Fitted together, what is less than the rest makes up for it."""
    fit = start_fit(CAUSES[0], np.zeros(9))._replace(hypothesis=None, x=np.zeros(COUNT))
    for name, x in (("kp", most), ("kv", 0.1), ("damping", -0.1)):
        fit.x[TOLERANCES.index(name)] = x
    judge = judged(STRONG)
    judge.known = [fit]
    assert len(calibration(Verdict("none", [], [], None, [], judge))) == kept


def test_a_number_that_a_cause_sets_is_not_corrected_besides() -> None:
    """What a tolerance had taken on before the cause was named has no effect."""
    [less] = [h for h in CAUSES if h.law == ("armature", "less than nominal")]
    judge = judged(STRONG)

    def corrected(fit: Fit) -> list[str]:
        fit.x[TOLERANCES.index("armature")] = -1.0
        judge.known = [fit]
        verdict = Verdict("none", [], [], None, [], judge)
        return [row["cause"] for row in calibration(verdict)]

    plain = start_fit(less, np.log([0.1]))._replace(hypothesis=None, x=np.zeros(COUNT))
    assert corrected(plain) == ["armature"]
    assert corrected(start_fit(less, np.log([0.1]))) == []


def test_causes_act_in_the_order_of_the_simulated_joint(tmp_path: Path) -> None:
    """Found in another order: a delay would delay what a dead band makes of angles."""
    known = add_cause(arm(tmp_path), "dead_band", ["nod"], 0.01)
    known = add_cause(known, "payload", ["nod"], 0.1)
    judge = judged(STRONG)
    judge.joints = [
        judge.joints[0]._replace(name=name, index=k)
        for k, name in enumerate(("lift", "turn", "nod"))
    ]
    laws = [
        next(h for h in CAUSES if h.law == law)
        for law in (
            ("dead_band", ""),
            ("speed_limit", "target"),
            ("command_delay", ""),
            ("first_order_lag", ""),
            ("load_friction", "of the servo's torque"),
            ("stiction", ""),
            ("torque_saturation", ""),
            ("supply_sag", ""),
        )
    ]
    judge.case.supply = 20.0
    claims = [Claim(law, np.array(law.starts[0]), (0,), {}, 0.0) for law in laws]
    causes = [Cause(claim, 1.0, [], []) for claim in claims]
    verdict = Verdict("named", causes, [], None, [], judge)
    rows = [
        {"cause": name, "where": ["lift"], "values": values, "role": "calibration"}
        for name, values in (
            ("command_delay", {"delay": 0.001}),
            ("encoder_offset", {"offset": 0.002}),
            ("encoder_offset", {"offset": 0.01, "in_loop": 1.0}),
        )
    ]
    world = extended(verdict, known, rows)
    assert [effect.rpartition("_")[0] for effect in world.motor] == [
        "command_delay", "command_delay", "first_order_lag", "speed_limit",
        "encoder_offset", "dead_band",
    ]  # fmt: skip
    assert [effect.rpartition("_")[0] for effect in world.joint] == [
        "supply_sag", "torque_saturation", "stiction", "load_friction"
    ]  # fmt: skip
    assert [row["cause"] for row in world.causes][:1] == ["payload"]
    assert len(world.causes) == 2 + 8 + 3
    assert sum(row.get("role") == "calibration" for row in world.causes) == 3


def test_two_asymmetric_frictions_are_one(tmp_path: Path) -> None:
    """Known 0.4 forwards, found 0.3 less: 0.1 forwards, and nothing backwards."""
    world = arm(tmp_path)
    one = {"torque": 0.1, "viscous": 0.4}
    world = add_cause(world, "asymmetric_friction", ["lift", "turn"], one)
    found = [{"cause": "asymmetric_friction", "where": ["lift"],
              "values": {"torque": 0.05, "viscous": -0.3}}]  # fmt: skip
    rows = claimed(judged(STRONG), [], world, found).causes
    both = {row["where"][0]: row["values"] for row in rows}
    assert both["lift"] == pytest.approx({"torque": 0.15, "viscous": 0.1})
    assert both["turn"] == pytest.approx(one)


def test_asymmetric_frictions_of_opposite_directions_stay_two(tmp_path: Path) -> None:
    """Known 0.3 forwards, found 0.3 backwards: dry friction, not none."""
    world = arm(tmp_path)
    one = {"torque": 0.3, "viscous": 0.4}
    world = add_cause(world, "asymmetric_friction", ["lift"], one)
    found = [{"cause": "asymmetric_friction", "where": ["lift"],
              "values": {"torque": -0.2, "viscous": -0.3}}]  # fmt: skip
    rows = [row["values"] for row in claimed(judged(STRONG), [], world, found).causes]
    assert rows[0] == pytest.approx({"torque": 0.3, "viscous": 0.1})
    assert rows[1:] == [{"torque": -0.2, "viscous": 0.0}]


def test_a_limit_that_a_joint_has_is_not_written_beside_its_servos(tmp_path) -> None:
    world = arm(tmp_path)
    file = tmp_path / "robot" / "arm.xml"
    limit = 'name="lift" actuatorfrcrange="-3 3" '
    file.write_text(file.read_text().replace('name="lift" ', limit))
    raised = {"limit": 4.5, "raised": 1.5}
    world = nominal(world.task, file, 5e-4)
    world = add_cause(world, "torque_limit", ["lift"], raised)
    (tmp_path / "found").mkdir()
    write_model(tmp_path / "found" / "extended.xml", world)
    found = mujoco.MjModel.from_xml_path(str(tmp_path / "found" / "extended.xml"))
    assert found.actuator_forcerange[0] == pytest.approx([-4.5, 4.5])
    assert not found.jnt_actfrclimited.any()
