"""Which commands of a run got lost: a beam search through the joint's simulation.

At each command a hypothesis splits in two: it arrived, or the target before it stays in
force. All are simulated side by side; the half that predicts the readings best goes on
(beam search, Lowerre 1976).
"""

from __future__ import annotations

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from gatjax.diagnosis import plant
from gatjax.diagnosis.hypotheses import Hypothesis, numbers
from gatjax.diagnosis.joint import STEP, Joint
from gatjax.diagnosis.laws import Drive, Grid, Servo, weighed

Array = Any
WIDTH = 512  # hypotheses
SURELY = 1e6  # cost of what cannot be


class Events(NamedTuple):
    """What happens at each step of a run [K]."""

    comes: Array  # 1: a command
    tick: Array  # which
    command: Array  # rad, the newest one
    read: Array  # 1: a reading falls between the step before and this one
    part: Array  # where between them, 0 to 1
    reading: Array  # rad


class Chances(NamedTuple):
    """Of losses, which come in bursts (a Markov chain, Gilbert 1960)."""

    begin: float  # of a burst, at each tick outside of one
    end: float  # of a burst, at each tick inside

    @property
    def nats(self) -> np.ndarray:
        """What a tick costs [2, 2], by the one before it and itself: 1 is lost."""
        one = np.array([[1.0 - self.begin, self.begin], [self.end, 1.0 - self.end]])
        return -np.log(one)


class Beam(NamedTuple):
    """Hypotheses: state of the joint, target in force, cost, each [W]."""

    state: plant.Rigid
    held: Array
    cost: Array


def events(joint: Joint, run: int, command: np.ndarray, drive: dict) -> Events:
    """Lay commands [N] and readings of a run on the grid of the simulation."""
    count, rows = joint.grid.target.shape[0], len(command)
    time = joint.time[run, :rows]
    comes, read, part, reading = np.zeros((4, count))
    begins = np.ceil((time + drive["delay"]) / STEP - 0.5).astype(int) + joint.lead
    newest = np.maximum(np.searchsorted(begins, np.arange(count), "right") - 1, 0)
    first = np.flatnonzero(np.diff(newest, prepend=-1) > 0)
    comes[first[1:]] = 1.0
    place = (time * (1.0 - drive.get("drift", 0.0)) - drive.get("late", 0.0)) / STEP
    place = np.clip(place + (joint.lead - 1.0), 0.0, count - 2.0)
    at = np.floor(place).astype(int) + 1
    read[at], part[at] = joint.valid[run, :rows], place - at + 1.0
    reading[at] = joint.measured[run, :rows]
    return Events(comes, newest, command[newest], read, part, reading)


def lost(
    joint: Joint, hypothesis: Hypothesis | None, x: np.ndarray,
    log: tuple[int, np.ndarray], noise: float, chances: Chances,
) -> np.ndarray:  # fmt: skip
    """Losses [N] of a run's commands that explain its readings best.

    Args:
        joint: with nominal numbers.
        hypothesis: what is known about it; not of a gear.
        x: its coordinates, tolerances first.
        log: number of the run, and its commands [N] rad.
        noise: rad, standard deviation of what a right pattern leaves.
        chances: of losses.
    """
    run, command = log
    drive = joint.nominal | numbers(joint, hypothesis, x)
    given = events(joint, run, command, drive)
    packed = joint.packed([drive])
    packed = Drive(*(field[None] for field in packed[:-1]), terms=packed.terms)
    series = Grid(*(field[:, run : run + 1] for field in joint.grid))
    nats = chances.nats.astype(np.float32)
    parents, cost = map(np.asarray, _searched(packed, series, given, noise, nats))
    gone, best = np.zeros(len(command), bool), int(np.argmin(cost))
    steps = np.flatnonzero(given.comes)
    for step, tick in zip(steps[::-1], given.tick[steps][::-1], strict=True):
        gone[tick] = best >= WIDTH // 2
        best = int(parents[step, best])
    return gone


@jax.jit
def _searched(p: Drive, g: Grid, e: Events, noise: Array, nats: Array) -> tuple:
    """Parents of the hypotheses at each step [K, W], and their costs at the end [W]."""
    first = jnp.full((1, WIDTH), e.command[0], jnp.float32)
    zero = jnp.zeros_like(first)
    memory = Servo(first, first, zero, zero)
    cost = jnp.where(jnp.arange(WIDTH) == 0, 0.0, SURELY).astype(jnp.float32)
    start = Beam(plant.Rigid(first, zero, zero, zero, memory), first[0], cost)

    def split(beam: Beam, command: Array) -> tuple[Beam, Array]:
        order = jnp.argsort(beam.cost)[: WIDTH // 2]
        parent = jnp.concatenate([order, order])
        state = jax.tree.map(lambda leaf: leaf[:, parent], beam.state)
        held, cost = beam.held[order], beam.cost[order]
        was = nats[(order >= WIDTH // 2).astype(int)]  # the lost ones stand behind
        same = jnp.abs(held - command) < 1e-6
        worse = cost + jnp.where(same, SURELY, was[:, 1])
        held = jnp.concatenate([jnp.full_like(held, command), held])
        return Beam(state, held, jnp.concatenate([cost + was[:, 0], worse])), parent

    def stay(beam: Beam, command: Array) -> tuple[Beam, Array]:
        return beam, jnp.arange(WIDTH)

    def step(beam: Beam, x: tuple) -> tuple[Beam, Array]:
        now, at = x
        beam, parent = jax.lax.cond(now.comes > 0.0, split, stay, beam, now.command)
        old = beam.state
        new = plant.rigid_step(p, at, beam.held[None], old.q, old, STEP)
        seen = old.q + now.part * (new.q - old.q) + p.zero_in + p.zero_out
        error = (seen[0] * p.scale[0] - now.reading) / noise
        cost = beam.cost + now.read * 0.5 * jnp.square(error)
        return Beam(new, beam.held, cost), parent

    events = jax.tree.map(lambda field: jnp.asarray(field, jnp.float32), e)
    last, parents = jax.lax.scan(step, start, (events, weighed(p, g)))
    return parents, last.cost
