"""One control tick of the pilot (steering and two engine ticks) in numpy, by batch."""

import numpy as np
import pytest

from gatjax import task as tasks
from gatjax.records import Reading
from gatjax.walk.parameters import THETA0

TICK = 0.02  # s, what the robot leaves for one call


@pytest.mark.parametrize("batch", [1, 160, 3000])
def test_pilot_tick(benchmark, ratio, batch):
    policy = THETA0 if batch == 1 else np.tile(THETA0, (batch, 1))
    lead = policy.shape[:-1]
    angle = tasks.pose(policy)
    reading = Reading(
        angle=angle,
        gyro=np.zeros((*lead, 3)),
        accelerometer=np.broadcast_to([0.0, 0.0, 9.81], (*lead, 3)),
        force=np.full((*lead, 8), 6.6),
    )
    task, go, state = tasks.Task(), np.zeros(lead, int), tasks.begin(policy)

    def tick():
        return tasks.pilot(task, policy, go, state, reading)

    benchmark(tick)
    ratio("share_of_a_control_tick", benchmark.stats.stats.median, TICK)
