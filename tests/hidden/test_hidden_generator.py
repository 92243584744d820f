"""The generator of hidden-effect cases: its plants, effects and files."""

import json
import math
from pathlib import Path

import mujoco
import numpy as np
import pytest

from gatjax.data.recording import check_recording, read_recording
from gatjax.surrogate.hidden import dart, rigid, single, write_cases
from gatjax.surrogate.hidden.catalogue import CATALOGUE
from gatjax.surrogate.hidden.design import MIX, plan
from gatjax.surrogate.hidden.feet import stand
from gatjax.surrogate.hidden.measure import positions
from gatjax.surrogate.hidden.motions import MOTIONS, commands
from gatjax.surrogate.hidden.numbers import Extra, Specimen, draw, nominal
from gatjax.surrogate.hidden.oracle import nominal_run
from gatjax.surrogate.hidden.outside import OUTSIDE
from gatjax.surrogate.hidden.places import allowed
from gatjax.surrogate.hidden.robots import ROBOTS, robot
from gatjax.surrogate.hidden.sight import strength
from gatjax.surrogate.hidden.stances import stance
from gatjax.surrogate.hidden.study import run
from gatjax.surrogate.hidden.targets import Lane, Log, lose

CONTRACT = Path(__file__).parents[1] / "data" / "hidden_effects.json"
RATE = 100.0


def even(seconds):
    return np.arange(int(seconds * RATE)) / RATE


def log_of(machine, kind, seconds=2.0, seed=3):
    time = even(seconds)
    return Log(time, commands(machine, kind, time, np.random.default_rng(seed)), (1,))


def angles(plant, machine, specimens, log):
    lanes = [Lane(specimen, log) for specimen in specimens]
    histories = plant(machine, lanes)
    return np.stack([positions(*pair) for pair in zip(lanes, histories, strict=True)])


def rms(values):
    return float(np.sqrt(np.mean(np.square(values))))


@pytest.mark.parametrize(
    ("name", "plant"),
    [
        ("arm_servo", single.simulate),
        ("arm_servo", dart.simulate),
        ("leg_six", rigid.simulate),
        ("quad_hung", dart.simulate),
        ("nao_hung", rigid.simulate),
    ],
)
def test_nominal_numbers_move_like_the_nominal_file(name, plant):
    # 2 mrad: the servo loop's sampling and the bristles, which MuJoCo lacks
    machine = robot(name)
    log = log_of(machine, "steps")
    ours = angles(plant, machine, [Specimen(nominal(machine))], log)[0]
    assert rms(ours - nominal_run(machine, log)) < 2e-3


def test_dart_and_mujoco_agree_on_a_drawn_leg():
    machine = robot("leg_six")
    drawn = Specimen(draw(machine, np.random.default_rng(5)))
    log = log_of(machine, "steps")
    ours = [
        angles(p, machine, [drawn], log)[0] for p in (rigid.simulate, dart.simulate)
    ]
    np.testing.assert_allclose(ours[0], ours[1], atol=2e-5)


@pytest.mark.parametrize("plant", [single.simulate, rigid.simulate])
def test_a_link_rattles_by_the_width_of_the_play(plant):
    # The motor sticks; a torque larger than the weight moves the link to and fro.
    machine, width = robot("arm_servo"), 0.08
    numbers = nominal(machine)
    numbers["coulomb"] = numbers["coulomb"] + 3.0
    gear = {"play": width, "stiffness": math.inf, "encoder_on_motor": 0.0}
    push = {"amplitude": 0.4, "frequency": 1.0, "phase": 0.0}
    extras = (Extra("gear", 0, gear), Extra("shake", 0, push))
    still = Log(even(2.0), np.zeros((200, 1)), (1,))
    on_motor = (extras[0]._replace(values={**gear, "encoder_on_motor": 1.0}), extras[1])
    link, motor = angles(
        plant, machine, [Specimen(numbers, extras), Specimen(numbers, on_motor)], still
    )
    gap = np.median(link[link > 0.0]) - np.median(link[link < 0.0])
    assert gap == pytest.approx(width, rel=0.05)
    assert np.ptp(motor) < 0.1 * width


def test_sticking_is_exact_in_the_one_joint_plant():
    machine = robot("arm_servo")
    numbers = nominal(machine)
    numbers["coulomb"] = numbers["coulomb"] + 0.8
    time = even(1.5)
    still = Log(time, np.full((len(time), 1), 0.05), (1,))
    moved = still._replace(commands=np.where(time[:, None] < 0.5, 0.05, 0.08))
    for log in (still, moved):  # 0.03 rad of 13 N m/rad is less than the friction
        shown = angles(single.simulate, machine, [Specimen(numbers)], log)[0]
        assert np.ptp(shown) == 0.0


def test_a_tilt_is_gravity_turned_against_the_mounting():
    machine = robot("arm_servo")  # turns about x: a roll moves where it hangs
    tilted = nominal(machine)
    tilted["kp"] = 1e-9 * tilted["kp"]
    tilted["coulomb"] = 0.0 * tilted["coulomb"]
    turned = {**tilted, "tilt": np.array([0.3, 0.0])}
    time = even(4.0)
    log = Log(time, np.zeros((len(time), 1)), (1,))
    ends = [
        angles(plant, machine, [Specimen(tilted), Specimen(turned)], log)[:, -1, 0]
        for plant in (single.simulate, rigid.simulate)
    ]
    for upright, leaning in ends:
        assert abs(abs(leaning - upright) - 0.3) < 0.02
    np.testing.assert_allclose(ends[0], ends[1], atol=2e-3)


@pytest.mark.parametrize("table", [CATALOGUE, OUTSIDE], ids=["catalogue", "outside"])
@pytest.mark.parametrize("name", ["arm_servo", "arm_two"])
def test_every_effect_changes_the_log_more_when_stronger(table, name):
    machine = robot(name)
    log = log_of(machine, "rich", 8.0)
    bare = Specimen({**nominal(machine), "period": np.array(5e-4)})
    rng = np.random.default_rng(0)
    names = [n for n in allowed(machine, table) if table[n].robots != "floor"]
    specimens, joints = [bare], list(range(len(machine.joints)))
    for effect in names:
        cause = table[effect]
        places = joints if cause.where == "all" else [len(joints) - 1]
        ladder, details = cause.ladder(machine, places, rng)
        if effect == "encoder_offset":
            details = {"in_loop": False}
        ladder = ladder[[0, -1]]
        specimens += [cause.apply(bare, machine, places, v, details) for v in ladder]
    shown = angles(rigid.simulate, machine, specimens, log)
    weak = {n: rms(shown[1 + 2 * k] - shown[0]) for k, n in enumerate(names)}
    strong = {n: rms(shown[2 + 2 * k] - shown[0]) for k, n in enumerate(names)}
    assert [n for n in names if not strong[n] > 1.2 * weak[n]] == []
    assert [n for n in names if not strong[n] > 5e-4] == []


def test_strength_meets_the_visibility_that_is_asked_for():
    ladder, seen = np.geomspace(0.01, 1.0, 6), np.geomspace(0.1, 10.0, 6)[:, None]
    assert strength(ladder, seen, seen[2, 0]) == pytest.approx(ladder[2], rel=1e-4)
    assert strength(ladder, seen, 1e3) == pytest.approx(ladder[-1], rel=1e-4)
    failed = np.where(np.arange(6)[:, None] > 2, np.nan, seen)
    assert strength(ladder, failed, 1e3) == pytest.approx(ladder[2], rel=1e-4)


def test_lost_targets_come_in_bursts_at_their_share():
    log = Log(np.arange(40000) / RATE, np.arange(40000.0)[:, None], (3,))
    lost = np.diff(lose(log, np.array([0.2]))[:, 0]) == 0.0
    starts = np.sum(lost[1:] & ~lost[:-1])
    assert np.mean(lost) == pytest.approx(0.2, abs=0.02)
    assert np.sum(lost) / starts == pytest.approx(3.0, abs=0.3)


@pytest.mark.parametrize("kind", MOTIONS)
@pytest.mark.parametrize("name", [name for name in ROBOTS if name != "nao_floor"])
def test_motions_stay_in_range_and_begin_at_home(name, kind):
    machine = robot(name)
    targets = log_of(machine, kind, 10.0, seed=7).commands
    assert (targets >= machine.low).all()
    assert (targets <= machine.high).all()
    np.testing.assert_allclose(targets[0], machine.home, atol=0.02)
    assert np.ptp(targets, axis=0).min() > 0.1


def test_a_null_case_does_not_match_perfectly_but_nearly():
    # shared set: 2 to 7 mrad on null cases
    cases = [plan(2, index, {"null": 1.0}, ["arm_two"], None) for index in range(8)]
    cases = [case for case in cases if case.engine == "rigid"][:3]
    before = [result.oracle["before"] for result in run(cases)]
    assert 1e-3 < np.mean(before) < 8e-3


def test_a_case_depends_on_seed_and_index_only():
    cases = [plan(4, index, MIX, ["arm_two"], None) for index in range(3)]
    case = plan(4, 2, MIX, ["arm_two"], None)
    np.testing.assert_array_equal(case.fits[0].times, cases[2].fits[0].times)
    log = log_of(robot("arm_two"), "steps", 1.0)
    alone = angles(rigid.simulate, case.robot, [case.bare], log)[0]
    among = angles(rigid.simulate, case.robot, [c.bare for c in cases], log)[2]
    np.testing.assert_array_equal(alone, among)


def test_the_robot_on_the_floor_stands_and_steps():
    machine = robot("nao_floor")
    time = even(4.0)
    targets = stance(machine, "stepping", time, np.random.default_rng(2))
    specimen = Specimen(draw(machine, np.random.default_rng(2)))
    (history,) = rigid.simulate(machine, [Lane(specimen, Log(time, targets, (1,)))])
    weight = 9.81 * specimen.numbers["mass"].sum()
    forces = history.body[:, 9:]
    assert np.abs(history.body[:, 6:8]).max() < 0.2
    assert forces.sum(1).mean() == pytest.approx(weight, rel=0.02)
    left = forces[:, :4].sum(1) / forces.sum(1)
    assert left.min() < 0.25 and left.max() > 0.75
    lowest = stand(machine, targets[:1])[0, 2]
    assert 0.25 < lowest < 0.33


def test_the_imu_turns_what_it_feels():
    machine = robot("nao_floor")
    time = even(0.5)
    log = Log(time, np.tile(machine.home, (len(time), 1)), (1,))
    bare = Specimen(nominal(machine))
    turned = CATALOGUE["imu_misalignment"].apply(
        bare, machine, [], 0.1, {"heading": 0.0}
    )
    histories = rigid.simulate(machine, [Lane(bare, log), Lane(turned, log)])
    before, after = (history.body[-1] for history in histories)
    assert after[6] - before[6] == pytest.approx(0.1, abs=1e-3)
    assert after[4] == pytest.approx(9.81 * math.sin(0.1 + before[6]), abs=0.05)


@pytest.fixture(scope="module")
def written(tmp_path_factory):
    folder = tmp_path_factory.mktemp("hidden")
    seen = []
    write_cases(
        folder,
        3,
        5,
        mix={"single": 1.0, "outside": 1.0},
        robots=["arm_two"],
        causes=["gain_error", "command_delay"],
        progress=lambda done, count: seen.append((done, count)),
    )
    assert seen == [(1, 3), (2, 3), (3, 3)]
    return folder


def test_files_are_recordings_of_the_written_model(written):
    model = mujoco.MjModel.from_xml_path(str(written / "models/arm_two.xml"))
    joints = [model.joint(index).name for index in range(model.njnt)]
    cases = sorted((written / "cases").iterdir())
    assert [case.name for case in cases] == ["h5_0000", "h5_0001", "h5_0002"]
    for case in cases:
        files = sorted(path.name for path in case.glob("*.parquet"))
        assert files[-1] == "held.parquet" and len(files) >= 2
        for name in files:
            recording = read_recording(case / name)
            check_recording(recording, joints)
            assert recording.metadata["base"] == "fixed"
            counts = recording.columns["position.elbow"] * 4096 / (2 * math.pi)
            np.testing.assert_allclose(counts, np.rint(counts), atol=1e-6)


def test_answers_follow_the_shared_schema(written):
    document = json.loads((written / "answers.json").read_text())
    for case in document["cases"]:
        effects = case["causes"] or case["hidden"]
        assert case["kind"] in ("single", "outside")
        assert (
            case["verdict"] == {"single": "named", "outside": "unknown"}[case["kind"]]
        )
        assert case["in_main_score"] == (case["d"] >= 0.8)
        for effect in effects:
            assert 0.3 < effect["d"] / effect["target_d"] < 3.0
        if case["kind"] == "single" and case["d"] > 3.0:
            assert case["oracle"]["gain"] > 0.2
    contract = json.loads(CONTRACT.read_text())
    assert set(contract["document"]) == set(document)
    assert set(contract["case"]) <= set(document["cases"][0])
    more = document["main_parameter"].items() - contract["main_parameter"].items()
    assert more == {("torque_saturation", "torque")}  # a cause that gatjax has besides
    assert len(document["main_parameter"]) == len(contract["main_parameter"]) + 1


def test_unknown_names_are_refused(tmp_path):
    with pytest.raises(ValueError, match="arm_three"):
        write_cases(tmp_path, 1, 0, robots=["arm_three"])
    with pytest.raises(ValueError, match="gremlins"):
        write_cases(tmp_path, 1, 0, robots=["arm_two"], causes=["gremlins"])
    with pytest.raises(ValueError, match="tripel"):
        write_cases(tmp_path, 1, 0, mix={"tripel": 1.0}, robots=["arm_two"])
