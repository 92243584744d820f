"""Loads along the motion that fits make, of joints whose encoders err."""

import numpy as np
import pytest
from test_diagnosis_everywhere import LEG, ODD, OFFSET, crooked, judged

from gatjax.diagnosis import case as cases
from gatjax.diagnosis import fit as fits
from gatjax.diagnosis import joint as joints
from gatjax.diagnosis import motion
from gatjax.diagnosis.bank import CAUSES
from gatjax.diagnosis.fit import put_together
from gatjax.diagnosis.hypotheses import COUNT, numbers

EVERY = range(len(LEG.joints))


def law(cause, variant=""):
    return next(h for h in CAUSES if h.law == (cause, variant))


def at(joint, *parts, rounds=6):
    point = put_together(np.zeros(COUNT), list(parts))
    return fits.improve(joint, fits.start(joint, [point]), rounds)[0]


@pytest.fixture(scope="module")
def judge(tmp_path_factory):
    return judged(tmp_path_factory.mktemp("leg"), crooked)


def test_a_link_is_where_it_is_whatever_its_encoder_reads(judge):
    told = at(
        judge.joints[ODD], (law("encoder_offset", "log only"), np.array([OFFSET]))
    )
    known = [told if k == ODD else judge.known[k] for k in EVERY]
    case = cases.along(judge.case, judge.joints, known)
    for k in EVERY:
        grid, before = case.joints[k].grid, judge.joints[k].grid
        running = np.asarray(grid.running) > 0.0
        apart = np.asarray(grid.reading - grid.path)[running]
        assert apart == pytest.approx(OFFSET if k == ODD else 0.0, abs=0.02)
        off = np.asarray(grid.reading - before.reading)[running]
        assert np.sqrt(np.mean(np.square(off))) < 0.02  # as measured


def test_a_drawn_joint_keeps_its_encoder_offset_on_loads_along_its_motion(judge):
    told = at(
        judge.joints[ODD], (law("encoder_offset", "log only"), np.array([OFFSET]))
    )
    known = [told if k == ODD else judge.known[k] for k in EVERY]
    case = cases.along(judge.case, judge.joints, known)
    drawn = case.joints[ODD].drawn(30.0)
    again = fits.start(drawn, [(told.hypothesis, told.x)])[0]
    assert again.rms() < 2.0 * drawn.noise
    (moved,) = fits.improve(drawn, [again], 6)
    assert moved.x[-1] == pytest.approx(told.x[-1], abs=0.005)


@pytest.mark.parametrize(
    ("cause", "variant", "own"),
    [
        ("measurement_delay", "", np.log(0.05)),
        ("encoder_scale", "", 0.1),
        ("encoder_offset", "in loop", 0.05),
        ("clock_drift", "", 0.01),
    ],
)
def test_what_an_encoder_reads_is_what_the_plant_says(judge, cause, variant, own):
    joint, run = judge.joints[0], judge.case.runs[0]
    point = put_together(np.zeros(COUNT), [(law(cause, variant), np.array([own]))])
    drive = joint.nominal | numbers(joint, *point)
    outcome = joint.outcome([drive], False, moving=True)
    fine = motion.grid_time([run], joints.STEP)[:: motion.FINE]
    angle = np.asarray(outcome.angle)
    read = joint.read(drive, angle, fine)
    stamps = run.time - run.time[0]
    seen = np.asarray(outcome.readings)[0, : len(stamps), 0]
    link, read = (
        np.interp(stamps, fine, each[:, 0])
        for each in (angle[:: motion.FINE, :, 0], read)
    )
    assert np.abs(read - seen).max() < 0.003 < 0.2 * np.abs(link - seen).max()
