"""Loads along the motion that fits make, of joints whose encoders err."""

import numpy as np
import pytest
from test_diagnosis_everywhere import LEG, ODD, OFFSET, crooked, judged

from gatjax.diagnosis import case as cases
from gatjax.diagnosis import fit as fits
from gatjax.diagnosis.bank import CAUSES
from gatjax.diagnosis.fit import put_together
from gatjax.diagnosis.hypotheses import COUNT

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
