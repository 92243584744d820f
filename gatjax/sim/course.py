"""A run tick by tick inside compiled code, whatever steps the physics."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp

from gatjax import task as tasks
from gatjax.records import Signal
from gatjax.robot.model import slots as find_slots
from gatjax.sim import episode
from gatjax.sim.actuation import actuation
from gatjax.sim.world import Values, World

Array = Any


class Engine(NamedTuple):
    """What steps the physics of one robot; its data are a pytree of its own."""

    begin: Callable[[Array, Array], Any]  # (qpos [nq], qvel [nv]) -> data
    see: Callable[[Any], episode.Plant]  # (data) -> plant
    advance: Callable[..., tuple]
    # (values, data, servo state, target [J] rad) -> data, servo state a tick later


class Place(NamedTuple):
    """Where a run is between two control ticks."""

    loop: episode.Loop
    data: Any  # of the engine
    servos: Any
    noise: Array  # [2] words of the run's noise key
    go: Array  # [] int, control tick of the walk request
    tick: Array  # [] int, control ticks so far


class Course(NamedTuple):
    """The three parts of a run."""

    begin: Callable[[Values, Array, Array], Place]  # (values, policy [15], key)
    look: Callable[[Values, Array, Place], tuple[Place, Signal, episode.Row]]
    # reads the sensors and asks the pilot: what the servos would be told, and the row
    move: Callable[[Values, Place, Array], Place]  # plays targets [J] rad for one tick


def course(world: World, engine: Engine) -> Course:
    """Return the parts of a run of one robot in a world."""
    where, servos = find_slots(world.model), actuation(world)

    def begin(values: Values, policy: Array, key: Array) -> Place:
        start_key, noise_key = jax.random.split(key)
        start = episode.start(world, where, policy, start_key)
        data = engine.begin(start.qpos, start.qvel)
        plant = engine.see(data)
        loop = episode.open_loop(world, values, policy, plant)
        stand = tasks.pose(policy)[episode.joints_of(world.model)]
        still = jnp.zeros_like(plant.velocity)
        first = Signal(stand, plant.reading.angle, plant.velocity, still)
        noise = jax.random.key_data(noise_key)
        return Place(loop, data, servos.init(values, first), noise, start.go,
                     jnp.int32(0))  # fmt: skip

    def look(
        values: Values, policy: Array, place: Place
    ) -> tuple[Place, Signal, episode.Row]:
        key = jax.random.wrap_key_data(place.noise)
        control = episode.control(world, values, policy, key, place.go)
        plant = engine.see(place.data)
        angle = servos.seen(values, place.servos, plant.reading.angle)
        plant = plant._replace(reading=plant.reading._replace(angle=angle))
        loop, signal, row = control(place.loop, place.tick, plant)
        return place._replace(loop=loop, tick=place.tick + 1), signal, row

    def move(values: Values, place: Place, target: Array) -> Place:
        data, state = engine.advance(values, place.data, place.servos, target)
        return place._replace(data=data, servos=state)

    return Course(begin, look, move)
