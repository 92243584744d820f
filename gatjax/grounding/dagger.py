"""GAT whose inverse model is retrained where the grounded simulator goes.

The paper's future work: f_sim^-1 is learned from the plain simulator and used in the
grounded one, whose states are others. As in dataset aggregation (Ross & Bagnell 2012),
the policy walks in the simulator grounded so far, what the simulator was told and did
there is added to the data, and f_sim^-1 is learned again from all of them.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from gatjax.grounding.gat import (
    GAT,
    Gat,
    gat_effect,
    learn_forward,
    learn_inverse,
)
from gatjax.grounding.grounder import Experience, Grounder

ROUNDS = 3  # in which f_sim^-1 is learned again


def learn(experience: Experience) -> tuple[Gat, dict[str, Any]]:
    """Learn f once and f_sim^-1 again and again."""
    forward, forward_fit = learn_forward(experience.robot, experience.seed)
    data, fits = list(experience.simulator), []
    inverse, fit = learn_inverse(data, experience.seed + 1)
    fits.append(fit)
    for number in range(ROUNDS):
        grounded = Gat(np.float32(1.0), forward, inverse)
        data += experience.play("gat", grounded, number)
        inverse, fit = learn_inverse(data, experience.seed + 1)
        fits.append(fit)
    facts = {
        "forward": forward_fit._asdict(),
        "inverse": fits[-1]._asdict(),
        "rounds": [each.validation_rmse for each in fits],
    }
    return Gat(np.float32(1.0), forward, inverse), facts


DAGGER = Grounder(effect=gat_effect, learn=learn, template=GAT.template)
