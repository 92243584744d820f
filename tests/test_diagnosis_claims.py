"""Claims about several joints beside those about one."""

import numpy as np
import pytest

from gatjax.diagnosis.claims import Claim, outdone
from gatjax.diagnosis.hypotheses import Hypothesis


def claim(cause, where, gain):
    none = Hypothesis(cause, "", lambda *_: None, (), (), (), (), lambda *_: {})
    return Claim(none, np.zeros(1), where, dict.fromkeys(where), gain)


@pytest.mark.parametrize(("gains", "expected"), [
    ({("lag", 0): 52.0, ("stiction", 1): 58.0}, True),  # 110, less 10
    ({("lag", 0): 52.0, ("stiction", 1): 30.0}, False),
    ({("lag", 0): 70.0, ("lag", 1): 30.0, ("tilt", 1): 9.0}, True),
    ({("", 0): 300.0}, False),  # a law without a name explains nothing
    ({("lag", 2): 300.0}, False),  # of another joint
    ({}, False),
])  # fmt: skip
def test_one_value_at_two_joints_beside_a_cause_of_each(gains, expected):
    single = [claim(cause, (joint,), gain) for (cause, joint), gain in gains.items()]
    assert outdone(claim("friction", (0, 1), 77.0), single) == expected


@pytest.mark.parametrize(("best", "expected"), [("lag", False), ("tilt", True)])
def test_a_value_that_most_joints_would_have_as_their_own_is_theirs(best, expected):
    gains = {
        ("lag", 0): 30.0,
        ("lag", 1): 30.0,
        (best, 2): 30.0,
        ("friction", 3): 500.0,
    }
    single = [claim(cause, (joint,), gain) for (cause, joint), gain in gains.items()]
    assert outdone(claim("lag", (0, 1, 2, 3), 95.0), single) == expected
