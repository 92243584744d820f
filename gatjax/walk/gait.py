"""The Walk2014 engine, ut15 variant: one tick from readings to joint commands.

Written from the behaviour of the public rUNSWift 2014 and UT Austin Villa engines, as
described in gatjax's design notes; checked tick for tick against their recorded traces
(`tests/test_walk_reference.py`). Every field is one robot's scalar, or a batch of them.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from gatjax.records import JOINTS
from gatjax.walk.legs import ANKLE_HEIGHT, Legs, solve
from gatjax.walk.parameters import Constants, Gait, unpack
from gatjax.walk.steps import SLACK, Request, bump, plan, smooth
from gatjax.xp import namespace_of, settled

Array = Any

STAND, STANDUP, CROUCH, WALK, READY, NONE = 0, 1, 2, 3, 4, 6  # options, trace codes
WALKING, STARTING, STOPPING, NOT_WALKING = 0, 1, 2, 3  # walk states, trace codes
AT_HEIGHT = 1e-4  # m
KNEE_RANGE = np.deg2rad(60.0)
PRESSURE_WEIGHTS = np.array([0.08, 0.03, 0.08, 0.03, -0.03, -0.08, -0.03, -0.08])  # m
PRESSURE_START, PRESSURE_CAP = 0.1, 5.0  # kg
GRAVITY = 9.81  # m/s^2, converts N to the engine's kg
SHOULDER_PITCH, SHOULDER_ROLL = np.deg2rad(90.0), np.deg2rad(7.0)


class GaitState(NamedTuple):
    """Everything the engine remembers between ticks."""

    option: Array  # [...] int, STAND .. NONE
    walk_state: Array  # [...] int, WALKING .. NOT_WALKING
    ticks: Array  # [...] int, engine ticks since the support change
    timer: Array  # [...] int, engine ticks since a crouch or stand-up began
    period: Array  # [...] s, nominal step time
    switch_period: Array  # [...] s, step time of the step in progress; 0 if none
    hip: Array  # [...] m, hip over ground
    hip_before: Array  # [...] m, when the crouch or stand-up began
    com: Array  # [...] m, both feet behind the hips
    forward: Array  # [...] m, step size
    left: Array  # [...] m, step size
    turn: Array  # [...] rad, step size, clockwise
    left_before: Array  # [...] m, sideways step size of the step before
    foot: Array  # [..., 2] m, feet behind the hips
    foot_before: Array  # [..., 2] m, at the last support change
    side: Array  # [..., 2] rad, feet to the right
    swing: Array  # [...] rad, sideways angle kept at the last support change
    toes: Array  # [...] rad, toes apart; the hip-yaw-pitch command is its negative
    toes_before: Array  # [...] rad, at the last support change
    lift: Array  # [..., 2] m
    arms: Array  # [..., 2] rad
    gyro_pitch: Array  # [...] rad/s, filtered
    left_swing: Array  # [...] bool, the left foot swings
    zmp: Array  # [...] m, lateral centre of pressure, left positive
    pressure_max: Array  # [..., 8] kg
    power: Array  # [...] last read
    bend: Array  # [...] last read


def reset(policy: Array) -> GaitState:
    """Return the engine's state before its first tick; the pose is not known yet."""
    xp = namespace_of(policy)
    zero = 0.0 * policy[..., 0]
    count = zero.astype(xp.int32)
    pair = xp.stack([zero, zero], axis=-1)
    gait = unpack(policy)
    return GaitState(
        option=count + NONE, walk_state=count + NOT_WALKING, ticks=count, timer=count,
        period=zero + gait.base_walk_period, switch_period=zero,
        hip=zero + Constants().stand_hip_height,
        hip_before=zero + Constants().stand_hip_height, com=zero,
        forward=zero, left=zero, turn=zero, left_before=zero, foot=pair,
        foot_before=pair, side=pair, swing=zero, toes=zero, toes_before=zero, lift=pair,
        arms=pair, gyro_pitch=zero, left_swing=zero > 1.0, zmp=zero,
        pressure_max=xp.stack([zero + PRESSURE_START] * 8, axis=-1),
        power=zero, bend=zero,
    )  # fmt: skip


def crouched(policy: Array) -> GaitState:
    """Return the state of a robot that stands ready at its walk height."""
    gait = unpack(policy)
    state = reset(policy)
    return state._replace(
        option=state.option * 0 + READY,
        hip=0.0 * state.hip + gait.walk_hip_height,
        com=0.0 * state.com + gait.com_offset,
    )


def _pressure(state: GaitState, force: Array) -> GaitState:
    """Update the lateral centre of pressure from foot forces, kg."""
    xp = namespace_of(force)
    grows = (force > state.pressure_max) & (state.pressure_max < PRESSURE_CAP)
    pressure_max = xp.where(grows, force, state.pressure_max)
    share = force / pressure_max
    total = share.sum(-1)
    weights = xp.asarray(PRESSURE_WEIGHTS, dtype=force.dtype)
    weights = xp.broadcast_to(weights, share.shape)
    safe = xp.where(xp.abs(total) > 1e-6, total, 1.0)
    zmp = xp.where(xp.abs(total) > 1e-6, (weights * share).sum(-1) / safe, 0.0)
    return state._replace(zmp=zmp, pressure_max=pressure_max)


def _read(
    gait: Gait, constants: Constants, state: GaitState, request: Request
) -> GaitState:
    """Read the request at the start of a step (every tick when not walking)."""
    xp = namespace_of(state.hip)
    steps = plan(gait, constants, request, (state.forward, state.left))
    idle = (request.forward == 0) & (request.left == 0)
    idle = idle & (request.turn == 0) & (request.power == 0)
    now = state.ticks == 0

    def at_start(new: Array, old: Array) -> Array:
        return xp.where(now, new, old)

    return state._replace(
        left_before=at_start(state.left, state.left_before),
        bend=at_start(xp.where(idle, 0.0, request.bend), state.bend),
        power=at_start(request.power, state.power),
        period=at_start(steps.period, state.period),
        forward=at_start(steps.forward, state.forward),
        left=at_start(steps.left, state.left),
        turn=at_start(steps.turn, state.turn),
    )


def _choose(gait: Gait, constants: Constants, state: GaitState) -> GaitState:
    """Choose between standing, standing up, crouching, being ready and walking."""
    xp = namespace_of(state.hip)
    zero = (state.forward == 0) & (state.left == 0) & (state.turn == 0)
    walking = (state.option == WALK) & (state.walk_state != NOT_WALKING)
    tall = xp.abs(state.hip - constants.stand_hip_height) < AT_HEIGHT
    low = xp.abs(state.hip - gait.walk_hip_height) < AT_HEIGHT
    stand = xp.where(tall, STAND, STANDUP)
    ready = xp.where(low, READY, CROUCH)
    walk = xp.where(low, WALK, CROUCH)
    option = xp.where(zero & (state.bend == 1), ready, walk)
    option = xp.where(state.bend == 0, stand, option)
    option = xp.where(walking, WALK, option).astype(state.option.dtype)
    enters = (option == WALK) & (state.option != WALK)
    walk_state = xp.where(enters, STARTING, state.walk_state)
    walk_state = xp.where(walking & zero, STOPPING, walk_state)
    moves = (option == STANDUP) | (option == CROUCH)
    begins = moves & (option != state.option)
    return state._replace(
        option=option,
        walk_state=walk_state.astype(state.walk_state.dtype),
        switch_period=xp.where(enters, state.period, state.switch_period),
        hip_before=xp.where(begins, state.hip, state.hip_before),
        timer=xp.where(begins, 0, state.timer).astype(state.timer.dtype),
    )


def _move_hip(
    gait: Gait, constants: Constants, dt: float, state: GaitState
) -> GaitState:
    """Run the option: hip height, body shift, and halting where it does not walk."""
    xp = namespace_of(state.hip)
    option = state.option
    share = smooth(
        state.timer * dt, constants.crouch_stand_period + 0.0 * state.hip, 0.0, dt
    )
    goal = xp.where(option == STANDUP, constants.stand_hip_height, gait.walk_hip_height)
    moving = state.hip_before + (goal - state.hip_before) * share
    moves = (option == STANDUP) | (option == CROUCH)
    hip = xp.where(moves, moving, state.hip)
    hip = xp.where(option == STAND, constants.stand_hip_height, hip)
    hip = xp.where(option == WALK, gait.walk_hip_height, hip)
    com = xp.where(option == STANDUP, 0.98 * state.com, state.com)
    com = xp.where(option == CROUCH, gait.com_offset * share, com)
    com = xp.where(option == STAND, 0.0, com)
    com = xp.where(option == WALK, gait.com_offset, com)
    walks = option == WALK
    return state._replace(
        hip=hip,
        com=com,
        timer=xp.where(moves, state.timer + 1, state.timer),
        ticks=xp.where(walks, state.ticks, 0),
        switch_period=xp.where(walks, state.switch_period, 0.0),
        forward=xp.where(walks, state.forward, 0.0),
        left=xp.where(walks, state.left, 0.0),
        turn=xp.where(walks, state.turn, 0.0),
    )


def _swing_side(state: GaitState, p: Array, q: Array, left: Array) -> Array:
    """Sideways angles [..., 2] if the left foot (`left` true) or the right swings."""
    xp = namespace_of(p)
    sign = xp.where(left, 1.0, -1.0)  # the step opens to this side
    angle = 0.5 * xp.arctan(state.left * p / (state.hip - ANKLE_HEIGHT))
    reverses = state.left_before * state.left < 0
    opening = angle - xp.where(reverses, state.swing * (1.0 - q), 0.0)
    closing = state.swing * (1.0 - p)
    opens = sign * state.left > 0
    # an opening step sets the support foot first, a closing one the swing foot
    support = xp.where(opens, opening, -closing)
    swing = -support
    return xp.stack(
        [xp.where(left, swing, support), xp.where(left, support, swing)], axis=-1
    )


def _place_feet(gait: Gait, dt: float, state: GaitState) -> GaitState:
    """Foot targets of the step in progress."""
    xp = namespace_of(state.hip)
    time = state.ticks * dt
    period = xp.where(state.switch_period > 0, state.switch_period, 1.0)
    p, q = smooth(time, period, 0.0, dt), smooth(time, period, 0.1, dt)
    line = xp.clip(time / period, 0.0, 1.0)
    height = (
        gait.base_leg_lift
        + gait.forward_extra_foot_height * xp.abs(state.forward)
        + gait.left_extra_foot_height * xp.abs(state.left)
    ) * bump(time / period)
    left = state.left_swing
    swings = xp.stack([left, ~left], axis=-1)
    quarter = 0.25 * state.forward[..., None]
    goal = xp.where(swings, -quarter, quarter)
    share = xp.where(swings, p[..., None], line[..., None])
    foot = state.foot_before + (goal - state.foot_before) * share
    inward, outward = 0.33 * state.turn, 0.67 * state.turn
    toes_goal = xp.where(
        left,
        xp.where(state.turn < 0, -outward, -inward),
        xp.where(state.turn < 0, inward, outward),
    )
    toes = state.toes_before + (toes_goal - state.toes_before) * p
    lift = xp.where(swings, height[..., None], 0.0)
    side = _swing_side(state, p, q, left)

    starting = state.walk_state == STARTING
    first = starting[..., None]
    foot = xp.where(first, 0.0, foot)
    active = (state.option == WALK) & (state.switch_period > 0)
    both = active[..., None]
    lift = xp.where(first, lift / gait.start_lift_divisor[..., None], lift)
    return state._replace(
        foot=xp.where(both, foot, state.foot),
        side=xp.where(both, xp.where(first, 0.0, side), state.side),
        toes=xp.where(active, xp.where(starting, 0.0, toes), state.toes),
        lift=xp.where(both, lift, 0.0),
        arms=xp.where(both, -foot * gait.arm_swing[..., None], state.arms),
    )


def _change_support(
    constants: Constants, dt: float, zmp_before: Array, state: GaitState
) -> GaitState:
    """Swap the feet when the pressure changes sides, or after a time-out."""
    xp = namespace_of(state.hip)
    time = state.ticks * dt
    early = constants.min_switch_fraction * state.period + SLACK
    late = constants.timeout_multiple * state.period + SLACK
    change = ((time > early) & (zmp_before * state.zmp < 0)) | (time > late)
    left_swing = xp.where(change, state.zmp < 0, state.left_swing)
    change = change & (state.option == WALK)
    after = xp.where(state.walk_state == NOT_WALKING, STARTING, WALKING)
    after = xp.where(state.walk_state == STOPPING, NOT_WALKING, after)
    swing = xp.where(left_swing, state.side[..., 0], state.side[..., 1])
    both = change[..., None]
    return state._replace(
        left_swing=left_swing,
        swing=xp.where(change, swing, state.swing),
        switch_period=xp.where(change, state.period, state.switch_period),
        walk_state=xp.where(change, after, state.walk_state).astype(
            state.walk_state.dtype
        ),
        ticks=xp.where(change, 0, state.ticks),
        toes_before=xp.where(change, state.toes, state.toes_before),
        foot_before=xp.where(both, state.foot, state.foot_before),
    )


def _joints(constants: Constants, state: GaitState) -> Array:
    """Joint targets [..., J] of the present state; head and hands stay at zero."""
    xp = namespace_of(state.hip)
    legs = solve(
        state.hip[..., None], state.lift, state.foot + state.com[..., None],
        state.side, -state.toes[..., None],
    )  # fmt: skip
    balance = state.gyro_pitch / constants.ankle_gyro_divisor
    active = (state.option == WALK) & (state.switch_period > 0)
    balance = xp.where(active, balance, 0.0)
    left = state.left_swing
    tilt = xp.stack([xp.where(left, 0.0, balance), xp.where(left, balance, 0.0)], -1)
    legs = legs._replace(ankle_pitch=legs.ankle_pitch + tilt)
    zero = 0.0 * state.hip
    arms = SHOULDER_PITCH + state.arms

    def leg(index: int) -> dict[str, Array]:
        side = "LR"[index]
        fields = zip(Legs._fields, legs)
        return {
            side + name.title().replace("_", ""): angle[..., index]
            for name, angle in fields
        }

    legs = settled(legs)
    named = {**leg(0), **leg(1)}
    named["LHipYawPitch"] = -state.toes
    named["LShoulderPitch"], named["RShoulderPitch"] = arms[..., 0], arms[..., 1]
    named["LShoulderRoll"] = zero + SHOULDER_ROLL
    named["RShoulderRoll"] = zero - SHOULDER_ROLL
    return xp.stack([named.get(name, zero) for name in JOINTS], axis=-1)


def pose(policy: Array) -> Array:
    """Joint targets [..., J] of a robot that is ready to walk, rad."""
    return _joints(Constants(), crouched(policy))


def tick(
    policy: Array,
    constants: Constants,
    dt: float,
    state: GaitState,
    request: Request,
    gyro: Array,
    force: Array,
    knee: Array,
) -> tuple[GaitState, Array]:
    """Advance the engine by one tick.

    Args:
        policy: [..., 15], order of `PARAMETERS`.
        constants: engine constants.
        dt: engine tick, s (0.01 in the original).
        state: from `reset`, `crouched` or the tick before.
        request: speeds that are asked for.
        gyro: [..., 3] rad/s, torso frame.
        force: [..., 8] N, foot forces, order of FORCE_SENSORS.
        knee: [...] rad, measured left knee; used on the first tick after `reset`.

    Returns:
        The new state and the joint targets [..., J] rad, before joint limits.
    """
    xp = namespace_of(policy)
    gait = unpack(policy)
    zmp_before = state.zmp
    state = _pressure(state, force / GRAVITY)
    drop = gait.walk_hip_height - constants.stand_hip_height
    bent = knee / KNEE_RANGE * drop + constants.stand_hip_height
    state = state._replace(hip=xp.where(state.option == NONE, bent, state.hip))
    state = _read(gait, constants, state, request)
    state = state._replace(ticks=state.ticks + 1)
    state = _choose(gait, constants, state)
    state = _move_hip(gait, constants, dt, state)
    state = _place_feet(gait, dt, state)
    state = _change_support(constants, dt, zmp_before, state)
    weight = constants.gyro_filter_old_weight ** (dt / 0.01)
    filtered = weight * state.gyro_pitch + (1.0 - weight) * gyro[..., 1]
    state = state._replace(gyro_pitch=filtered)
    return state, _joints(constants, state)
