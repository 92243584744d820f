"""A diagnosis that starts from a world: what is known besides the model.

That known causes move a joint as the World does is in test_diagnosis_world.py.
"""

import json
from pathlib import Path

import numpy as np
import pytest

import gatjax.surrogate.hidden
from gatjax.data.recording import Recording
from gatjax.diagnosis.bank import CAUSES, of_drive
from gatjax.diagnosis.case import held, unfitted
from gatjax.diagnosis.closeness import LONGEST, beyond_noise, lasting
from gatjax.diagnosis.diagnose import diagnose
from gatjax.diagnosis.fit import Fit, evidence, spread
from gatjax.diagnosis.given import Logs, given
from gatjax.diagnosis.hypotheses import COUNT
from gatjax.diagnosis.start import ADDING, Start, _unfit, read_start
from gatjax.diagnosis.tolerances import USUAL, WIDE, read_tolerances
from gatjax.effects.catalogue import CATALOGUE
from gatjax.robot.model import joint_names, load
from gatjax.sim.replay import replay_many
from gatjax.sim.stored import read_world, write_world
from gatjax.sim.world import add_cause, nominal, stacked
from gatjax.task import Task

ARM = f"{gatjax.surrogate.hidden.__path__[0]}/arm_servo.xml"
PERIOD = 0.02
silent = lambda stage, share: None  # noqa: E731
DELAY, LAG = {"delay": 0.03}, {"time_constant": 0.05}


def written(path, *causes):
    """A world file with some causes at the servo."""
    world = nominal(Task(control_period=PERIOD), ARM, 0.0005)
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
    command -= command[30]
    command[:30] = 0.0  # at rest, where the joint starts
    played = replay_many(
        world, stacked([world.values]), command[:, None], np.zeros(1), np.zeros(1)
    )
    angle = played.reading.angle[0] + 5e-4 * draw.normal(size=(500, 1))
    columns = {"command.servo": command, "position.servo": angle[:, 0]}
    metadata = {"robot": "arm", "base": "fixed"}
    return Recording(name, time, np.zeros(500, int), columns, metadata)


def test_causes_of_a_world_are_taken_for_read_start(tmp_path):
    written(tmp_path / "w.json", ("command_delay", DELAY), ("gain_error", 0.8),
            ("first_order_lag", LAG), ("command_delay", DELAY))  # fmt: skip
    start = read_start(tmp_path / "w.json")
    model = start.model()
    (assumed,) = start.joints(model)
    assert assumed.law(3.0) == {"delay": 0.06, "lag": 0.05}
    assert assumed.barred == {"first_order_lag"} and not assumed.geared
    assert assumed.named == {"command_delay", "gain_error", "first_order_lag"}
    plain = Start(ARM).model()
    ratio = model.actuator_gainprm[0, 0] / plain.actuator_gainprm[0, 0]
    assert ratio == pytest.approx(0.8)


@pytest.mark.parametrize("order", [(0, 1), (1, 0)])
def test_of_two_gears_the_later_one_says_what_both_have(order, tmp_path):
    """As in the simulator, of which the motor feels just this much friction."""
    share = {"encoder_on_motor": 1.0, "link_share": 0.8}
    two = (("backlash", {"width": 0.02, "damping_ratio": 0.3}),
           ("joint_elasticity", {"stiffness": 30.0, "damping_ratio": 0.1}))  # fmt: skip
    rows = [(two[k][0], two[k][1] | share) for k in order]
    world = written(tmp_path / "w.json", *rows, ("command_delay", DELAY),
                    ("command_delay", DELAY))  # fmt: skip
    (assumed,) = read_start(tmp_path / "w.json").joints(load(ARM))
    gear = world.values.joint["gear"]
    assert assumed.law(3.0) == {
        "width": gear.width[0], "stiffness": gear.stiffness[0],
        "ratio": gear.damping_ratio[0], "sensed": gear.encoder_on_motor[0],
        "link_share": gear.link_share[0], "behind": gear.armature_share[0],
        "linked": 0.0, "delay": 0.06,
    }  # fmt: skip
    assert assumed.law(3.0)["ratio"] == rows[1][1]["damping_ratio"]


def test_what_does_not_add_up_is_not_looked_for_again(tmp_path):
    world = written(tmp_path / "w.json", ("first_order_lag", LAG))
    start = read_start(tmp_path / "w.json")
    log = logged(world, "log", 0)
    case = given(start, Logs([log], []), 0)
    base = held(case.model, case.logs, 0, assumed=start.joints(case.model))
    (joint,) = unfitted(base, case.logs).joints
    names = {each.cause for each in of_drive(joint, CAUSES)}
    assert names == {each.cause for each in CAUSES} - {"first_order_lag"}


def placed(name, **more):
    """A row of a cause of a size that may be."""
    entry = CATALOGUE[name]
    low, high = entry.main.low, entry.main.high
    value = next(v for v in (0.5, 0.03, 0.003) if low <= v <= high)
    where = ["servo"] if entry.place in ("joint", "foot") else [entry.place]
    where = ["link"] if entry.place == "foot" else where
    return {"cause": name, "where": where, "values": {entry.main.name: value} | more}


def world_of(path, *rows, **more):
    """A world file of the servo with rows."""
    text = {"schema": "gatjax.world/1", "model": ARM, "effects": list(rows)} | more
    path.write_text(json.dumps(text))
    return path


REFUSED = {
    "dropped_commands": "hits ticks", "command_noise": "hits ticks",
    "imu_misalignment": "no joint", "ground_friction": "no joint",
    "ground_compliance": "no joint", "sole_geometry": "no joint",
    "current_limit": "no law of the single joint",
}  # fmt: skip


@pytest.mark.parametrize("name", sorted(set(CATALOGUE) - set(REFUSED)))
def test_every_cause_changes_the_joint_or_its_model(name, tmp_path):
    start = read_start(world_of(tmp_path / "w.json", placed(name)))
    plain, model = Start(ARM).model(), start.model()
    (assumed,) = start.joints(model)
    law = assumed.law(3.0)
    assert all(np.isfinite(list(law.values())))
    assert name in assumed.named and (name in assumed.barred) == (name not in ADDING)
    fields = (
        "actuator_gainprm", "actuator_biasprm", "actuator_forcerange", "dof_damping",
        "dof_frictionloss", "dof_armature", "body_mass", "body_ipos",
    )  # fmt: skip
    changed = (plain.opt.gravity != model.opt.gravity).any() or any(
        (getattr(plain, field) != getattr(model, field)).any() for field in fields
    )
    assert law or changed
    assert law or name in ADDING


@pytest.mark.parametrize("name", REFUSED)
def test_what_no_single_joint_shows_is_refused(name):
    assert REFUSED[name] in _unfit(placed(name))


def test_what_a_search_was_kept_to_is_not_known_of_a_robot(tmp_path):
    lag = placed("first_order_lag")
    bound = placed("current_limit") | {"role": "bound"}
    start = read_start(world_of(tmp_path / "w.json", lag, bound))
    assert [row["cause"] for row in start.rows] == ["first_order_lag"]


def test_worlds_that_cannot_be_started_from(tmp_path):
    lag, inside = placed("first_order_lag"), placed("encoder_scale", in_loop=1.0)
    inside["values"]["scale"] = 1.05
    for rows, reason in (([lag, lag], "comes twice"), ([inside], "in the loop")):
        with pytest.raises(ValueError, match=reason):
            read_start(world_of(tmp_path / "w.json", *rows))
    grounded = world_of(tmp_path / "w.json", grounding="grounding/", rate_hz=100.0)
    with pytest.raises(ValueError, match="has a grounding"):
        read_start(grounded)
    with pytest.raises(FileNotFoundError):
        read_start(tmp_path / "none.json")


def test_heat_and_supply_are_shares_of_what_the_joint_has(tmp_path):
    hot = placed("thermal_derating", cooling=20.0, heat=36.0)
    sag = placed("supply_sag", total=4.0)
    start = read_start(world_of(tmp_path / "w.json", hot, sag))
    (assumed,) = start.joints(start.model())
    assert assumed.law(3.0)["heat"] == pytest.approx(0.5 / 4.0)
    assert assumed.supply == 4.0
    log = logged(start.world(PERIOD), "log", 0)
    case = given(start, Logs([log], []), 0)
    base = held(case.model, case.logs, 0, assumed=start.joints(case.model))
    (joint,) = unfitted(base, case.logs).joints
    assert joint.nominal["sag"] == 0.5
    assert 0.01 < float(joint.grid.supply.max()) < 1.0


def test_joints_of_one_motor_stay_so_whatever_was_calibrated():
    source = str(Path(ARM).with_name("quad_hung.xml"))
    names = joint_names(load(source))
    row = {"cause": "gain_error", "where": [names[0]], "values": {"scale": 0.95}}
    start = Start(source, (row | {"role": "calibration"},))
    motors = [assumed.motor for assumed in start.joints(start.model())]
    assert motors[0] == motors[3] == motors[6] == motors[9]
    assert motors[0][0] == load(source).actuator_gainprm[0, 0]


def test_only_what_is_wrong_besides_is_named(tmp_path):
    world = written(tmp_path / "w.json", ("load_friction", {"coefficient": 0.3}))
    both = add_cause(world, "dead_band", ["servo"], 0.04)
    logs = Logs([logged(both, "fit", 1)], [logged(both, "held", 2)])
    found = diagnose(
        read_start(tmp_path / "w.json"),
        logs,
        tmp_path / "out",
        0,
        silent,
    )
    (cause,) = found["causes"]
    assert cause["cause"] == "dead_band"
    assert cause["parameters"]["half_width"]["value"] == pytest.approx(0.04, rel=0.1)
    rows = json.loads((tmp_path / "out" / "world.json").read_text())["effects"]
    told = [row["cause"] for row in rows if row.get("role", "cause") == "cause"]
    assert told == ["dead_band", "load_friction"]  # from the command to the joint
    assert found["made_by"]["world"] == str(tmp_path / "w.json")
    assert read_tolerances(tmp_path / "out/tolerances.json").close("servo") < 1e-3
    again = diagnose(
        read_start(tmp_path / "out"), Logs(logs.held, []), tmp_path / "more", 0, silent
    )
    assert again["verdict"] == "none"


def test_what_a_simulation_always_left_is_no_news(tmp_path):
    """No cause wanders; as far as held-out logs did, later ones may, too."""
    world = written(tmp_path / "w.json", ("first_order_lag", LAG))

    def wandering(name, seed):
        log = logged(world, name, seed)
        draw = np.random.default_rng(seed)
        wave = np.sin(2.0 * np.pi * draw.uniform(0.1, 0.6, 5) * log.time[:, None]
                      + draw.uniform(0.0, 6.0, 5)).sum(1)  # fmt: skip
        column = {"position.servo": log.columns["position.servo"] + 0.008 * wave}
        return log._replace(columns=log.columns | column)

    logs = Logs([logged(world, "fit", 1)], [wandering("held", 2)])
    first = diagnose(Start(ARM), logs, tmp_path / "out", 0, silent)
    assert [row["cause"] for row in first["causes"]] == ["first_order_lag"]
    allowed = read_tolerances(tmp_path / "out/tolerances.json")
    assert allowed.close("servo") == pytest.approx(0.008 * np.sqrt(2.5), rel=0.3)
    assert 0.2 < allowed.lasts("servo") < LONGEST  # waves of 0.1 to 0.6 Hz
    known, later = read_start(tmp_path / "out"), Logs([wandering("later", 3)], [])
    said = [
        diagnose(known, later, tmp_path / str(k), 0, silent, some)["verdict"]
        for k, some in enumerate((USUAL, allowed))
    ]
    assert said[0] != "none" and said[1] == "none"


def test_residuals_that_last_count_as_one(tmp_path):
    """Moving averages of 25 rows are independent after 0.5 s; nothing else changes."""
    log = logged(written(tmp_path / "w.json"), "log", 0)
    case = given(Start(ARM), Logs([log], []), 0)

    def fitted(**told):
        allowed = USUAL._replace(**told)
        (joint,) = unfitted(held(case.model, case.logs, 0, allowed), case.logs).joints
        time, valid = (np.tile(each, (20, 1)) for each in (joint.time, joint.valid))
        joint = joint._replace(time=time, valid=valid)
        rows, draw = int(joint.valid.sum()), np.random.default_rng(1)
        series = np.convolve(draw.normal(size=rows + 24), np.ones(25), "valid")
        empty = np.zeros((rows, COUNT)), np.eye(COUNT)
        return joint, Fit(None, np.zeros(COUNT), 0.0, series, *empty, 1.0, True)

    joint, fit = fitted()
    assert lasting(joint, fit) == pytest.approx(0.5, rel=0.25)
    swapped = fit._replace(residual=np.resize([1.0, -1.0], len(fit.residual)))
    assert lasting(joint, swapped) == pytest.approx(PERIOD)
    far = fit._replace(residual=np.full(len(fit.residual), 1e4))  # a diagnosis reads it
    assert beyond_noise(joint, far) == WIDE
    long, again = fitted(lasting={"servo": 0.5})
    assert evidence(long, again) == pytest.approx(0.2 * evidence(joint, fit))
    assert spread(long) == pytest.approx(np.sqrt(5.0) * spread(joint))


def test_how_close_is_close_enough_is_said_like_a_noise(tmp_path):
    log = logged(written(tmp_path / "w.json"), "log", 0)
    case = given(Start(ARM), Logs([log], []), 0)
    tight, wide = (
        unfitted(held(case.model, case.logs, 0, allowed), case.logs).joints[0].noise
        for allowed in (USUAL, USUAL._replace(angle=0.01))
    )
    assert tight < 1e-3
    assert wide == pytest.approx(np.hypot(tight, 0.01))


def test_an_order_that_the_simulated_joint_has_not_is_refused(tmp_path):
    band, inside = ("dead_band", {"half_width": 0.03}), ("encoder_offset", {
        "offset": 0.05, "in_loop": 1.0})  # fmt: skip
    written(tmp_path / "w.json", inside, band)
    assert len(read_start(tmp_path / "w.json").rows) == 2
    written(tmp_path / "w.json", band, ("encoder_offset", 0.05))  # of the log only
    assert len(read_start(tmp_path / "w.json").rows) == 2
    scale, zero = ("encoder_scale", 0.9), ("encoder_offset", 0.05)
    written(tmp_path / "w.json", zero, scale)
    assert len(read_start(tmp_path / "w.json").rows) == 2
    for offset in (zero, inside):
        written(tmp_path / "w.json", scale, offset)
        with pytest.raises(ValueError, match="encoder_scale stands before"):
            read_start(tmp_path / "w.json")
    written(tmp_path / "w.json", band, inside)
    with pytest.raises(ValueError, match="dead_band stands before encoder_offset"):
        read_start(tmp_path / "w.json")


def test_stiction_of_a_joint_too_slow_to_show_it_is_not_looked_for(tmp_path):
    written(tmp_path / "w.json")
    start = read_start(tmp_path / "w.json")
    model = start.model()
    files = Logs([logged(start.world(PERIOD), "fit", 0)], [])
    logs = given(start, files, 0).logs
    base = held(model, logs, 0, assumed=start.joints(model))
    (joint,) = unfitted(base, logs).joints
    assert "stiction" in {each.cause for each in of_drive(joint, CAUSES)}
    still = joint._replace(grid=joint.grid._replace(path=0.0 * joint.grid.path))
    assert "stiction" not in {each.cause for each in of_drive(still, CAUSES)}


def test_a_second_row_of_a_gear_changes_what_it_says_alone(tmp_path):
    play = ("backlash", {"width": 0.02, "link_share": 0.4, "damping_ratio": 0.2})
    spring = ("joint_elasticity", {"stiffness": 150.0, "damping_ratio": 0.3})
    full = ("joint_elasticity", {"link_share": 0.4, **spring[1]})
    worlds = []
    for rows in ((play, spring), (play, full)):
        written(tmp_path / "w.json", *rows)
        world, _ = read_world(tmp_path / "w.json", Task(control_period=PERIOD))
        start = read_start(tmp_path / "w.json")
        law = start.joints(start.model())[0].law(2.0)
        worlds.append((world.values.joint["gear"], law))
    (gear, law), (expected, told) = worlds
    for name in gear._fields:
        np.testing.assert_array_equal(getattr(gear, name), getattr(expected, name))
    assert law == told
    assert (law["ratio"], law["link_share"], law["width"]) == (0.3, 0.4, 0.02)
