"""The baseline that fits every number: what it says of those that moved."""

import numpy as np
import pytest
from test_diagnosis_plant import joint, wave

from gatjax.benchmark.everything import NUMBERS, named
from gatjax.benchmark.squares import Solved


@pytest.mark.parametrize(
    ("field", "own", "says"), [("delay", 0.03, 0.03), ("kp", np.log(2.0), 2.0)]
)
def test_a_number_is_told_as_the_catalogue_counts_it(field, own, says):
    x = np.zeros(len(NUMBERS))
    x[[number.field for number in NUMBERS].index(field)] = own
    fit = Solved(**dict.fromkeys(Solved._fields))._replace(own=x, deviation=0.0 * x)
    told = named([joint(wave)], [fit])
    (value,) = told["parameters"].values()
    assert told["where"] == ["elbow"] and value["value"] == pytest.approx(says)
