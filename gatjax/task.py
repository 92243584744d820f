"""What is asked of the robot, the pilot that does it, and what it cost.

The task is the paper's (Hanna & Stone 2017, Empirical Results): walk towards a target
at forward request 0.75; when the heading error passes five degrees, turn back while
walking on; a fall ends the run; the cost is the negative mean forward velocity, plus 15
for a fall. The same pilot runs in every simulator, on the stand-in robots and on the
hardware.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from gatjax.records import Base, Outcome, Reading
from gatjax.robot import nao
from gatjax.walk import gait
from gatjax.walk.parameters import Constants, unpack
from gatjax.walk.steps import Request
from gatjax.xp import namespace_of

Array = Any

RATES = {50.0: (0.02, 2), 100.0: (0.01, 1), 83.3: (0.012, 1)}
"""Control rate in Hz -> control period in s, engine ticks in it."""
FALLEN_UP, FALLEN_HEIGHT = 0.7, 0.20  # torso up-axis z; torso height, m
KNEE = nao.JOINTS.index("LKneePitch")


class Task(NamedTuple):
    """The walking task; fixed for a run."""

    control_period: float = 0.02  # s
    engine_ticks: int = 2  # engine ticks in a control period, sensors held
    forward: float = 0.75  # share of max_forward
    turn: float = 0.3  # share of max_turn while turning back
    turn_from: float = float(np.deg2rad(5.0))  # rad, heading error that starts a turn
    turn_until: float = float(np.deg2rad(1.0))  # rad, heading error that ends it
    settle: float = 0.5  # s of READY before the request
    longest_delay: float = 0.2  # s, the request comes up to this much later
    duration: float = 7.5  # s from the request
    fall_penalty: float = 15.0

    @property
    def ticks(self) -> int:
        """Control ticks that hold the longest run."""
        latest = sum(
            round(part / self.control_period)
            for part in (self.settle, self.longest_delay)
        )
        return latest + math.ceil(self.duration / self.control_period - 1e-9) + 1


def task_at(rate_hz: float, **changes: Any) -> Task:
    """Return the task at a control rate of 50, 100 or 83.3 Hz."""
    if rate_hz not in RATES:
        raise ValueError(f"rate {rate_hz} Hz is unknown; choose from {sorted(RATES)}")
    period, ticks = RATES[rate_hz]
    return Task(control_period=period, engine_ticks=ticks, **changes)


class PilotState(NamedTuple):
    """What the pilot remembers between control ticks."""

    gait: gait.GaitState
    tick: Array  # [...] int, control ticks so far
    heading: Array  # [...] rad, integrated yaw rate, left positive
    turning: Array  # [...] bool, turning back to the target


def begin(policy: Array) -> PilotState:
    """Return the pilot of a robot that stands ready, facing the target."""
    zero = 0.0 * policy[..., 0]
    state = gait.crouched(policy)
    return PilotState(state, 0 * state.ticks, zero, zero > 1.0)


def pose(policy: Array) -> Array:
    """Joint angles [..., J] of a robot that stands ready, within joint limits, rad."""
    xp = namespace_of(policy)
    return xp.clip(gait.pose(policy), *_limits(xp, policy))


def _limits(xp: Any, like: Array) -> tuple[Array, Array]:
    return xp.asarray(nao.LOW, like.dtype), xp.asarray(nao.HIGH, like.dtype)


def _steer(task: Task, state: PilotState, gyro: Array, walking: Array) -> PilotState:
    xp = namespace_of(gyro)
    turned = xp.where(walking, gyro[..., 2] * task.control_period, 0.0)
    heading = state.heading + turned
    error = xp.abs(heading)
    turning = (error > task.turn_from) | (state.turning & (error > task.turn_until))
    return state._replace(heading=heading, turning=turning)


def pilot(
    task: Task, policy: Array, go: Array, state: PilotState, reading: Reading
) -> tuple[PilotState, Array]:
    """Answer one reading with joint targets.

    Args:
        task: the task.
        policy: [..., 15] walk parameters.
        go: [...] int, control tick at which the walk is requested.
        state: from `begin` or the tick before.
        reading: what the robot reports now.

    Returns:
        The new state and joint targets [..., J] rad within the joint limits.
    """
    xp = namespace_of(policy, reading.angle)
    walking = state.tick >= go
    state = _steer(task, state, reading.gyro, walking)
    parameters = unpack(policy)
    side = -xp.sign(state.heading)
    turn = xp.where(walking & state.turning, side * task.turn, 0.0)
    zero = 0.0 * state.heading
    request = Request(
        forward=xp.where(walking, task.forward, 0.0) * parameters.max_forward,
        left=zero,
        turn=turn * parameters.max_turn,
        power=xp.where(walking, 1.0, 0.5) + zero,
        bend=zero + 1.0,
        speed=zero + 1.0,
    )
    walk, target = state.gait, None
    for _ in range(task.engine_ticks):
        walk, target = gait.tick(
            policy, Constants(), task.control_period / task.engine_ticks,
            walk, request, reading.gyro, reading.force, reading.angle[..., KNEE],
        )  # fmt: skip
    state = state._replace(gait=walk, tick=state.tick + 1)
    return state, xp.clip(target, *_limits(xp, policy))


class Score(NamedTuple):
    """Bookkeeping of one run."""

    origin: Array  # [...] m, where the request found the robot, towards the target
    reached: Array  # [...] m, where it is or ended
    fell_at: Array  # [...] s after the request, inf while it stands
    ok: Array  # [...] bool, False once a number is not finite
    alive: Array  # [...] bool, the run goes on


def open_score(base: Base) -> Score:
    """Return the score of a run that begins."""
    x = base.position[..., 0]
    return Score(x, x, 0.0 * x + np.inf, x == x, x == x)


def fallen(base: Base) -> Array:
    """Return whether the torso has tipped over or come down."""
    q = base.quaternion
    up = 1.0 - 2.0 * (q[..., 1] ** 2 + q[..., 2] ** 2)
    return (up < FALLEN_UP) | (base.position[..., 2] < FALLEN_HEIGHT)


def keep_score(task: Task, go: Array, tick: Array, score: Score, base: Base) -> Score:
    """Follow the run: `tick` is the control tick at which `base` was seen."""
    xp = namespace_of(base.position)
    x = base.position[..., 0]
    seconds = (tick - go) * task.control_period
    finite = xp.isfinite(base.position).all(-1) & xp.isfinite(base.quaternion).all(-1)
    down = score.alive & (fallen(base) | ~finite)
    seen = score.alive & finite
    return Score(
        origin=xp.where(seen & (tick <= go), x, score.origin),
        reached=xp.where(seen, x, score.reached),
        fell_at=xp.where(down, seconds, score.fell_at),
        ok=score.ok & (finite | ~score.alive),
        alive=score.alive & ~down & (seconds < task.duration - 1e-6),
    )


def cost_of(task: Task, velocity: Array, fell: Array) -> Array:
    """Return the cost, m/s, of walks at velocities in m/s that fell or did not."""
    xp = namespace_of(velocity)
    return -velocity + xp.where(fell, task.fall_penalty, 0.0)


def outcome(task: Task, score: Score) -> Outcome:
    """Return the verdict on a run.

    The distance counts to the fall, the time does not stop with it: a robot that falls
    early has not walked fast. A run that diverged costs inf.
    """
    xp = namespace_of(score.reached)
    velocity = (score.reached - score.origin) / task.duration
    cost = cost_of(task, velocity, xp.isfinite(score.fell_at))
    return Outcome(
        cost=xp.where(score.ok, cost, xp.inf),
        velocity=velocity,
        fell_at=score.fell_at,
        ok=score.ok,
    )
