"""A cause of a whole robot, as it is beside others at each joint that it helps."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from gatjax.diagnosis.claims import shared_value
from gatjax.diagnosis.fit import Fit
from gatjax.diagnosis.hypotheses import Hypothesis

SHARE = 0.5  # of joints that a cause of a robot has to be worth it at


class Option(NamedTuple):
    """A cause beside others, with a value of its own at each joint that it helps."""

    hypothesis: Hypothesis
    gains: dict[int, float]  # nats, each joint by itself
    fits: dict[int, Fit]  # as it was proposed or lent: the cause comes last
    gain: float = 0.0  # nats, all joints together

    @property
    def own(self) -> np.ndarray:
        """Coordinates of the cause that these joints agree on."""
        return shared_value(list(self.fits.values()), self.hypothesis)

    @property
    def law(self) -> tuple[str, str]:
        """Cause and variant."""
        return self.hypothesis.law

    def common(self, joints: int) -> bool:
        """Whether it is worth its own value at most of some joints."""
        return sum(gain > 0.0 for gain in self.gains.values()) > SHARE * joints
