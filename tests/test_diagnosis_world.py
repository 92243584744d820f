"""A cause means the same to the diagnosis and to the World: one joint in both.

The World plays a cause and logs it; the diagnosis reads the log as if it were measured,
weighs the arm along it and simulates the joint with the hypothesis's numbers, which
become the World's by `extend.world_values`. Both start at rest.

What is left is a share of what the cause does. Stepping is worth 1.5 mrad (1 ms in the
diagnosis, 0.5 ms in MuJoCo); most causes have the same error, so it cancels against the
nominal joint's, and a gear has less: the smaller of both counts. A wrong sign leaves
2, a cause that does nothing 1. The diagnosis is linear in what bodies and tilt change,
but for the inertia at the joint itself.
"""

import dataclasses

import jax
import mujoco
import numpy as np
import pytest

import gatjax.surrogate.hidden
from gatjax.data.trajectories import JointRun
from gatjax.diagnosis import assembly, joint, loads, motion
from gatjax.diagnosis import fit as fits
from gatjax.diagnosis.bank import CAUSES
from gatjax.diagnosis.case import Case, Held
from gatjax.diagnosis.claims import Claim
from gatjax.diagnosis.drawn import drawn_errors
from gatjax.diagnosis.extend import extended, world_values
from gatjax.diagnosis.hypotheses import COUNT, combined, tolerated
from gatjax.diagnosis.judge import Judge
from gatjax.diagnosis.regressor import Swing, shifts
from gatjax.diagnosis.start import Start
from gatjax.diagnosis.tolerances import USUAL
from gatjax.diagnosis.verdict import Cause, Verdict
from gatjax.effects.catalogue import CATALOGUE
from gatjax.robot.model import joint_names, load
from gatjax.sim.replay import replay_many
from gatjax.sim.world import add_cause, nominal, stacked
from gatjax.task import Task

PERIOD, ROWS, LEAD = 0.01, 400, 40
TIME = PERIOD * np.arange(ROWS)
FAST = np.sin(2.0 * np.pi * (0.4 + 0.15 * TIME) * TIME)
COMMAND = 0.4 * FAST + 0.5 * (TIME > 1.0) - 0.7 * (TIME > 2.5)
NAMES = {f"{each.cause} {each.variant}".strip(): each for each in CAUSES}
OWN = {  # coordinates, where the bank's middle start does too little or too much
    "torque_ripple": (0.1, 0.05, np.log(12.0)),
    "com_shift": (0.0, 0.08, 0.09),  # so far that its square counts
    "gravity_tilt": (0.25, 0.0),
    "clock_drift": (0.01,),  # a negative one reads beyond the end
    "thermal_derating": (-1.0, 3.0),
    "supply_sag": (np.log(0.2),),
    "command_quantization": (np.log(0.08),),
    "stiction": (np.log(0.3), np.log(0.8)),
    "asymmetric_friction": (-0.1,),
    "asymmetric_friction grows with speed": (-0.05, 1.0),
    "encoder_offset": (0.2,),
    "encoder_scale": (-0.08,),
    "load_friction": (np.log(0.3),),
    "backlash": (np.log(0.08), 0.3, 0.2, np.log(0.4)),
    "joint_elasticity": (np.log(1.0), 0.3, 0.2, np.log(0.2)),
}
WIDE = (np.log(0.2), 0.3, 0.2, np.log(0.4))  # of backlash
LEAST = {"coulomb_friction less than nominal": 2e-3}  # of 0.045 N m in all
SHARE = 0.08
MORE = {
    "coulomb_friction less than nominal": 0.25,  # 0.21: of 2 mrad, stepping has 0.4
    "backlash encoder on motor": 0.12,  # 0.08: of 5 mrad only, stepping has 0.4
    "stiction": 0.12,  # 0.09: Stribeck's friction changes within a few steps
    "load_friction of the link's torque": 0.12,  # 0.083: the motor's last speed-up
    "supply_sag": 0.2,  # 0.15: the diagnosis takes the load of the smoothed motion
}


@pytest.fixture(scope="module")
def world():
    folder = gatjax.surrogate.hidden.__path__[0]
    return nominal(Task(control_period=PERIOD), f"{folder}/arm_servo.xml", 0.0005)


def logged(world):
    """What the World's encoder says of COMMAND, [N] rad, after `LEAD` rows at rest."""
    told = np.concatenate([np.full(LEAD, COMMAND[0]), COMMAND])[:, None]
    state = np.zeros(1), np.zeros(1)
    played = replay_many(world, stacked([world.values]), told, *state, lead=LEAD)
    return played.reading.angle[0, LEAD:, 0]


def judged(world, angle):
    """What the diagnosis makes of a log [N] rad, before it fits anything.

    All causes of the world are known to it.
    """
    start = Start(world.source, world.causes)
    model = start.model()
    run = JointRun(0, TIME, COMMAND[:, None], angle[:, None])
    tree = loads.Tree(model, model.actuator_trnid[:, 0])
    fine = motion.grid_time([run], joint.STEP)[:: motion.FINE]
    moved = [motion.smoothed(run, run.angle, fine)]
    draw = np.random.default_rng(0)
    others = [loads.perturbed(model, USUAL, draw) for _ in range(loads.TERMS)]
    weighed = [loads.weigh(tree, moved[0], others)]
    base = Held(tree, [run], others, assumed=start.joints(model))
    names = joint_names(model)
    ready = assembly.build(
        model, tree, names, [run], moved, weighed, assumed=base.assumed
    )
    case = Case(
        base=base, runs=[run], joints=ready, motions=moved, loads=weighed, healthy=[],
    )  # fmt: skip
    return Judge(case, lambda stage, share: None)


def simulated(judge, hypothesis=None, own=()):
    """Readings [N] rad of the diagnosis's joint, tolerances and transport at zero."""
    (ready,) = judge.joints
    known = ready.assumed.law(ready.nominal["limit"])
    still = {name: known.get(name, 0.0) for name in ("delay", "stiction")}
    drive = tolerated(ready, np.zeros(COUNT)) | still
    if hypothesis is not None:
        hypothesis.put(drive, ready, np.array(own))
    geared = hypothesis is not None and hypothesis.geared
    return ready.simulate([drive], geared)[0, ready.valid[0], 0]


def fitted(hypothesis, own):
    """A fit with nominal tolerances, as far as a translation needs it."""
    x = np.append(np.zeros(COUNT), own)
    slopes, square = np.zeros((0, len(x))), np.eye(len(x))
    return fits.Fit(hypothesis, x, 0.0, np.zeros(0), slopes, square, 1.0, True)


def translated(judge, hypothesis, own):
    """The newest cause of a hypothesis as values of the World's."""
    newest = np.array(own)[-len(hypothesis.newest.low) :]
    claim = Claim(hypothesis.newest, newest, (0,), {0: fitted(hypothesis, own)}, 0.0)
    return world_values(judge, claim)


def rms(values):
    return float(np.sqrt(np.mean(np.square(values))))


@pytest.fixture(scope="module")
def plain(world):
    """The nominal log, what the diagnosis knows from it, and what it simulates."""
    angle = logged(world)
    judge = judged(world, angle)
    with jax.numpy_rank_promotion("allow"):  # the diagnosis broadcasts [R, S] by [S]
        return angle, judge, simulated(judge)


def test_the_nominal_joint_moves_the_same(plain):
    angle, _, ours = plain
    assert np.ptp(angle) > 1.0
    assert rms(ours - angle) < 2e-3  # 1.5e-3


def test_every_cause_of_the_bank_is_in_the_catalogue():
    assert {each.cause for each in CAUSES} <= set(CATALOGUE)
    assert len(NAMES) == len(CAUSES)


@pytest.mark.parametrize("name", NAMES)
def test_a_cause_moves_the_joint_the_same(name, world, plain):
    hypothesis, (angle, judge, ours) = NAMES[name], plain
    middle = hypothesis.starts[len(hypothesis.starts) // 2]
    own = OWN.get(name, OWN.get(hypothesis.cause, middle))
    where = ["all"] if CATALOGUE[hypothesis.cause].place == "all" else ["servo"]
    with jax.numpy_rank_promotion("allow"):
        values = translated(judge, hypothesis, own)
        changed = add_cause(world, hypothesis.cause, where, values)
        theirs = logged(changed)
        told = simulated(judged(world, theirs), hypothesis, own)
        known = simulated(judged(changed, theirs))
    effect = rms(theirs - angle)
    assert effect > LEAST.get(name, 4e-3)
    for seen in (known, told):
        left = min(rms(seen - theirs), rms((seen - ours) - (theirs - angle)))
        assert left < MORE.get(name, SHARE) * effect, left / effect


def test_a_weak_motor_that_warms_derates_as_it_was_fitted(world, plain):
    """Warmth is relative to the torque limit that the motor has, not to the nominal."""
    weak, warm = NAMES["torque_limit"], NAMES["thermal_derating"]
    both, limit = combined(weak, warm), (np.log(0.3),)
    own = (*limit, *OWN["thermal_derating"])
    with jax.numpy_rank_promotion("allow"):
        values = translated(plain[1], weak, limit)
        weaker = add_cause(world, "torque_limit", ["servo"], values)
        values = translated(plain[1], both, own)
        theirs = logged(add_cause(weaker, "thermal_derating", ["servo"], values))
        told = simulated(judged(world, theirs), both, own)
    effect = rms(theirs - logged(weaker))
    assert effect > 0.02
    assert rms(told - theirs) < SHARE * effect


@pytest.mark.parametrize("side", ["link", "motor"])
def test_load_friction_behind_a_gap_is_as_it_was_fitted(side, world, plain):
    gap = NAMES[f"backlash encoder on {side}"]
    rubs = NAMES["load_friction of the link's torque"]
    both, alone = combined(gap, rubs), OWN["backlash"]
    own = (*alone, *OWN["load_friction"])
    with jax.numpy_rank_promotion("allow"):
        worn = add_cause(world, "backlash", ["servo"], translated(plain[1], gap, alone))
        values = {"coefficient": 0.3, "of_link": 1.0}
        theirs = logged(add_cause(worn, "load_friction", ["servo"], values))
        told = simulated(judged(world, theirs), both, own)
    effect = rms(theirs - logged(worn))
    assert rms(told - theirs) < MORE[f"{rubs.cause} {rubs.variant}"] * effect


@pytest.mark.parametrize("name", [
    "load_friction of the servo's torque", "speed_limit motor", "stiction",
    "thermal_derating", "torque_ripple", "torque_saturation",
])  # fmt: skip
def test_what_a_motor_does_in_its_gap_is_as_it_was_fitted(name, world, plain):
    """Its servo, rubbing and ripple go by the motor's angle and speed."""
    gap, law = NAMES["backlash encoder on motor"], NAMES[name]
    more = OWN.get(law.cause, law.starts[len(law.starts) // 2])
    both, own = combined(gap, law), (*WIDE, *more)
    with jax.numpy_rank_promotion("allow"):
        worn = add_cause(world, "backlash", ["servo"], translated(plain[1], gap, WIDE))
        values = translated(plain[1], both, own)
        other = add_cause(worn, law.cause, ["servo"], values)
        angle, theirs = logged(worn), logged(other)
        without = simulated(judged(world, angle), gap, WIDE)
        told = simulated(judged(world, theirs), both, own)
    effect = rms(theirs - angle)
    left = min(rms(told - theirs), rms((told - without) - (theirs - angle)))
    assert effect > LEAST.get(name, 4e-3)
    assert left < SHARE * effect, left / effect


def test_a_gap_predicts_another_motion_of_a_joint_that_is_drawn_to_it(world, plain):
    gap, own = NAMES["backlash encoder on link"], OWN["backlash"]
    first = plain[1]
    with jax.numpy_rank_promotion("allow"):
        worn = add_cause(world, "backlash", ["servo"], translated(first, gap, own))
        angle = logged(worn)
        judge = judged(world, angle)
        zero, own = np.zeros(COUNT), np.array(own)
        healthy, known = fits.start(
            judge.joints[0], [(None, zero), (gap, np.append(zero, own))]
        )
        claim = Claim(gap, own, (0,), {0: known}, 100.0)
        judge.known, judge.accepted = [known], [claim]
        run = JointRun(0, TIME[:300], COMMAND[:300, None], angle[:300, None])
        for pulled in ({0: 10.0}, {}):  # the fit logs may be followed without
            judge.case = dataclasses.replace(
                judge.case, healthy=[healthy], pulled=pulled
            )
            before, after = drawn_errors(judge, [run])[0]
            assert len(before.block) == len(after.block) == 300
            assert after.rmse()[0] < 0.3 * before.rmse()[0]
        judge.accepted = [claim._replace(lost={0: [np.zeros(ROWS, bool)]})]
        assert drawn_errors(judge, [run]) == {}


@pytest.mark.parametrize("moved", [0, 1])
def test_a_far_shift_of_a_link_is_its_moments_and_a_spin(moved):
    """Both joints of a planar arm feel it, whichever link it is: parallel axes."""
    model = load(f"{gatjax.surrogate.hidden.__path__[0]}/arm_two.xml")
    tree = loads.Tree(model, model.actuator_trnid[:, 0])
    time = np.linspace(0.0, 2.0, 200)
    rates = np.array([3.0, 4.4])
    phase = time[:, None] * rates
    swing = motion.Motion(
        time, 0.4 * np.sin(phase), 0.4 * rates * np.cos(phase),
        -0.4 * rates**2 * np.sin(phase),
    )  # fmt: skip
    body, shift = int(tree.body[moved]), np.array([0.1, 0.0, -0.07])
    far = mujoco.MjModel.__copy__(model)
    far.body_ipos[body] += shift
    plain, there = (
        loads.Tree(each, model.actuator_trnid[:, 0]).loads(swing)
        for each in (model, far)
    )
    mass = model.body_mass[body]
    told = np.array([0.0, *shift, mass * float(shift @ shift)])
    told = told @ shifts(model, body, tree.axis[moved])
    felt = Swing(model, swing.position, swing.velocity, swing.acceleration)
    inertia = felt.masses(body, np.eye(2)) @ told
    rest = felt.forces(body) @ told - inertia * swing.acceleration
    assert np.abs(there.inertia - plain.inertia).max() > 0.005
    assert inertia == pytest.approx(there.inertia - plain.inertia, abs=1e-4)
    assert rest == pytest.approx(there.rest - plain.rest, abs=1e-3)


@pytest.mark.parametrize("found", [
    ("dead_band", "encoder_offset in loop"), ("dead_band", "command_delay"),
    ("dead_band", "speed_limit target"), ("speed_limit target", "command_quantization"),
    ("load_friction of the servo's torque", "torque_saturation"),
    ("load_friction of the link's torque", "torque_ripple"),
    ("thermal_derating", "torque_saturation"),
    ("backlash encoder on link", "asymmetric_friction"),
    ("joint_elasticity encoder on link", "asymmetric_friction grows with speed"),
    ("asymmetric_friction", "load_friction of the link's torque"),
    ("encoder_offset in loop", "encoder_scale"),
])  # fmt: skip
def test_causes_found_in_any_order_act_as_they_were_fitted(found, world, plain):
    (first, second), (angle, judge, ours) = (NAMES[name] for name in found), plain
    both, own, causes = combined(first, second), (), []
    with jax.numpy_rank_promotion("allow"):
        for law, name in zip((first, second), found, strict=True):
            middle = law.starts[len(law.starts) // 2]
            alone = OWN.get(name, OWN.get(law.cause, middle))
            own = (*own, *alone)
            fit = {0: fitted(law, alone)}
            claim = Claim(law, np.array(alone), (0,), fit, 0.0)
            causes.append(Cause(claim, 1.0, [], []))
        verdict = Verdict("named", causes, [], None, [], judge)
        both_there = extended(verdict, world, [])
        theirs = logged(both_there)
        told = simulated(judged(world, theirs), both, own)
        known = simulated(judged(both_there, theirs))
        worlds = [extended(verdict._replace(causes=[c]), world, []) for c in causes]
    effect = min(rms(theirs - logged(each)) for each in worlds)
    assert effect > 4e-3
    share = max(MORE.get(name, SHARE) for name in found)
    for seen in (told, known):
        left = min(rms(seen - theirs), rms((seen - ours) - (theirs - angle)))
        assert left < share * effect, left / effect
