"""The menu of motions: laws that hold for all of them, and what each one is for."""

import numpy as np
import pytest

from gatjax.effects.catalogue import CATALOGUE
from gatjax.motions import MENU, Limbs, chosen, motion, patterns
from gatjax.motions.menu import HUNG, MARGIN
from gatjax.motions.patterns import Stage, within_speed

RATE = 50.0
REST = 50  # rows of a second


def limbs(floating=False, **changes):
    """Five joints: two wide ones, one that rests at its limit, a narrow, a slow one."""
    given = {
        "names": ("a", "b", "edge", "narrow", "slow"),
        "limits": np.array(
            [[-2.0, 2.0], [-1.0, 3.0], [0.0, 1.0], [-0.02, 0.02], [-2.0, 2.0]]
        ),
        "home": np.array([0.0, 1.5, 0.0, 0.0, -1.0]),
        "speed": np.array([6.0, 4.0, 6.0, 6.0, 1.0]),
        "floating": floating,
    }
    return Limbs(**(given | changes))


ALL = np.ones(5, bool)


@pytest.fixture(params=sorted(MENU))
def entry(request):
    return MENU[request.param]


@pytest.mark.parametrize("seed", range(2))
@pytest.mark.parametrize("rate", [50.0, 83.3])
def test_motions_are_safe(entry, rate, seed):
    robot, joints = limbs(), np.array([True, True, True, True, False])
    target = entry.build(robot, joints, rate, seed, reach=0.9)
    assert target.shape == (round(entry.seconds * rate), 5)
    rest = round(rate)
    assert np.all(target[:rest] == robot.home)
    assert np.all(target[-rest:] == robot.home)
    assert np.all(target[:, 4] == robot.home[4])
    low, high = robot.limits.T
    room = np.minimum(MARGIN, [0.0, 0.0, 0.0, 0.02, 0.0])  # `narrow` has no more
    down, up = robot.home - low, high - robot.home
    assert np.all(target >= robot.home - 0.9 * np.maximum(down - MARGIN, 0.0) - 1e-12)
    assert np.all(target <= robot.home + 0.9 * np.maximum(up - MARGIN, 0.0) + 1e-12)
    assert np.all(target >= low + room) and np.all(target <= high - room)
    speed = np.abs(np.diff(target, axis=0)) * rate
    assert np.all(speed <= robot.speed * (1.0 + 1e-9))
    begin = speed[rest - 1 : rest + 2]  # the first steps out of rest are gentle
    assert np.all(begin <= 0.02 * robot.speed)


def test_motions_are_safe_at_very_low_speeds(entry):
    robot = limbs(speed=np.full(5, 0.2))
    target = entry.build(robot, ALL, RATE, 0, reach=1.0, seconds=60.0)
    assert np.all(np.abs(np.diff(target, axis=0)) * RATE <= 0.2 * (1.0 + 1e-9))
    assert np.all(target[-REST:] == robot.home)


def test_motions_need_no_speed_limit(entry):
    robot = limbs(speed=np.full(5, np.inf))
    target = entry.build(robot, ALL, RATE, 0, reach=1.0)
    assert np.isfinite(target).all()
    assert np.ptp(target[:, 0]) > 0.0


def test_a_seed_means_one_motion(entry):
    one, two, other = (entry.build(limbs(), ALL, RATE, seed) for seed in (3, 3, 4))
    np.testing.assert_array_equal(one, two)
    if entry.name != "repeat_five" and entry.name != "creep":  # these draw sides only
        assert np.any(one != other)


def test_every_wide_joint_moves(entry):
    target = entry.build(limbs(), ALL, RATE, 0)
    assert np.all(np.ptp(target, axis=0)[[0, 1, 2, 4]] > 0.02)


def test_what_a_motion_separates_are_causes(entry):
    assert len(entry.separates) >= 2
    assert set(entry.separates) <= set(CATALOGUE)
    assert "\n" not in entry.use and entry.separates[0] in entry.use


def test_a_standing_robot_reaches_less_far_the_more_joints_move(entry):
    knee = np.array([True, False, False, False, False])
    standing = limbs(floating=True)
    assert entry.reach(limbs(), ALL) == HUNG
    assert entry.reach(standing, ALL) == pytest.approx(entry.standing)
    assert entry.reach(standing, knee) == pytest.approx(entry.standing * np.sqrt(5.0))
    usual = entry.build(standing, ALL, RATE, 0)
    given = entry.build(standing, ALL, RATE, 0, reach=entry.standing)
    np.testing.assert_array_equal(usual, given)


@pytest.mark.parametrize(
    ("changes", "line"),
    [
        ({"reach": 0.0}, "reach is 0; use more than 0"),
        ({"reach": 1.1}, r"reach is 1\.1; use more than 0, at most 1"),
        ({"reach": float("nan")}, "reach is nan"),
        ({"rate_hz": 5.0}, "a motion at 5 Hz is not smooth"),
        ({"seconds": 5.0}, "5 s is too short for it; give it [89] s or more"),
        ({"moving": ~ALL}, "no joint to move; name at least one"),
        ({"limbs": limbs(home=np.full(5, 0.5))}, "narrow: home 0.5 rad lies outside"),
        ({"limbs": limbs(speed=np.zeros(5))}, "a: speed is 0 rad/s"),
    ],
)
def test_what_can_not_be_is_refused(changes, line):
    given = {"limbs": limbs(), "moving": ALL, "rate_hz": RATE, "seed": 0} | changes
    with pytest.raises(ValueError, match=line):
        MENU["rich"].build(**given)


def test_the_shortest_motion_is_the_one_that_the_refusal_names(entry):
    with pytest.raises(ValueError, match="give it") as refused:
        entry.build(limbs(), ALL, RATE, 0, seconds=3.0)
    least = float(str(refused.value).split("give it ")[1].split(" s")[0])
    assert len(entry.build(limbs(), ALL, RATE, 0, seconds=least)) == least * RATE


def test_unknown_names_are_refused_with_those_there_are():
    with pytest.raises(ValueError, match=r"'wave' is unknown; choose from rich, chirp"):
        motion("wave")
    with pytest.raises(ValueError, match=r"no joint 'c'; it has a, b, edge"):
        chosen(limbs(), ("a", "c"))
    np.testing.assert_array_equal(chosen(limbs(), ("b",)), np.arange(5) == 1)
    assert chosen(limbs(), ()).all()


# what each one is for


def stage(seconds=20.0, joints=3, seed=0):
    rows = round(seconds * RATE)
    half, speed = np.full(joints, 0.5), np.full(joints, 5.0)
    return Stage(rows, RATE, half, speed, np.random.default_rng(seed))


def test_chirp_goes_from_slow_to_quick():
    wave = patterns.chirp(stage())[:, 0]
    turns = np.flatnonzero(np.diff(np.sign(wave)) != 0) / RATE
    assert np.median(np.diff(turns[:3])) > 1.0 / (2.0 * 0.4)  # under 0.4 Hz
    assert np.median(np.diff(turns[-12:-4])) < 1.0 / (2.0 * 3.5)  # above 3.5 Hz


def test_small_steps_are_small_and_large_ones_large():
    small, large = patterns.steps_small(stage()), patterns.steps_large(stage())
    assert np.abs(small).max() <= 0.03
    assert np.abs(large).max() > 0.45
    for rows in (small, large):
        jumps = (np.diff(rows, axis=0) != 0).sum(axis=0)
        assert np.all((jumps > 20.0 / 1.0 - 4) & (jumps < 20.0 / 0.5))
        assert np.all(rows.max(axis=0) > 0) and np.all(rows.min(axis=0) < 0)


def test_slow_ramps_are_slow_cross_the_middle_and_lie_within_each_other():
    rows = patterns.slow(stage())
    assert np.abs(np.diff(rows, axis=0)).max() * RATE <= patterns.SLOW * (1 + 1e-9)
    for joint in rows.T:
        pieces = [np.ptp(piece) for piece in np.array_split(joint, 3)]
        np.testing.assert_allclose(sorted(pieces), [0.25, 0.5, 1.0], rtol=0.02)
        assert joint.max() > 0.4 and joint.min() < -0.4


def test_creep_hardly_moves():
    speed = np.abs(np.diff(patterns.creep(stage()), axis=0)) * RATE
    assert np.median(speed) == pytest.approx(patterns.CREEP)
    assert speed.max() <= patterns.CREEP * (1 + 1e-9)


def test_holds_rest_in_five_poses_that_share_out_the_range():
    rows = patterns.holds(stage())
    for joint in rows.T:
        still = joint[1:][np.diff(joint) == 0]
        levels, counts = np.unique(still.round(9), return_counts=True)
        rested = levels[counts > 1.5 * RATE]
        np.testing.assert_allclose(rested, [-0.5, -0.25, 0.0, 0.25, 0.5], atol=1e-9)


def test_multisine_has_tones_of_equal_speed():
    rows = patterns.multisine(stage())[:, 0]
    speed = np.abs(np.fft.rfft(rows)) ** 2 * np.arange(len(rows) // 2 + 1) ** 2
    lines = np.rint(patterns.TONES * 20.0).astype(int)
    near = np.array([speed[max(line - 2, 0) : line + 3].sum() for line in lines])
    share = near / speed.sum()  # the fade smears every line a little
    assert np.all((share > 0.05) & (share < 0.35))
    assert lines[-1] == 80


def test_repeats_are_the_same_to_the_bit():
    piece = patterns.repeated(stage(20.3))
    length = len(piece) // 5
    first = piece[:length]
    for index in range(1, 5):
        np.testing.assert_array_equal(first, piece[index * length :][:length])
    assert np.ptp(first) > 0.5 and np.all(first[-20:] == 0.0)
    slewed = within_speed(piece, np.full(3, 0.1))
    for index in range(1, 5):
        again = slewed[index * length :][:length]
        np.testing.assert_allclose(slewed[:length], again, atol=1e-12)


@pytest.mark.parametrize("joints", [3, 20])
def test_joints_move_alone_and_then_together(joints):
    groups = min(joints, 6)
    rows = patterns.together_alone(stage(joints=joints))
    slots = np.array_split(rows, groups + 2)
    movers = [(np.ptp(slot, axis=0) > 0.05).sum() for slot in slots]
    assert sum(movers[:groups]) == joints
    assert max(movers[:groups]) == -(-joints // groups)
    assert movers[groups:] == [joints, joints]


def test_rich_plays_all_its_parts():
    rows = patterns.rich(stage(30.0))
    quick, jumpy = rows[: round(0.3 * 1500)], rows[450:825]
    ramps, rests = rows[825:1200], rows[1200:]
    assert len(rows) == 1500
    assert (np.diff(np.sign(quick[:, 0])) != 0).sum() > 10
    assert np.abs(np.diff(jumpy, axis=0)).max() > 0.3
    assert np.abs(np.diff(ramps, axis=0)).max() * RATE <= patterns.SLOW * (1 + 1e-9)
    assert (np.diff(rests[:, 0]) == 0).mean() > 0.5


def test_speed_is_kept_and_slow_offsets_are_left_alone():
    time = np.arange(500)[:, None] / RATE
    slow = 0.2 * np.sin(np.pi * time / 10.0) ** 2
    slow[-1] = 0.0
    np.testing.assert_array_equal(within_speed(slow, np.array([0.1])), slow)
    jump = np.where((time > 2.0) & (time < 6.0), 1.0, 0.0)
    kept = within_speed(jump, np.array([0.02]))
    assert np.abs(np.diff(kept, axis=0)).max() <= 0.02 + 1e-12
    assert kept.max() == 1.0 and abs(kept[0, 0]) <= 0.02 and kept[-1, 0] == 0.0
