"""A run tick by tick inside compiled code, whatever steps the physics."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

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
    drawn: episode.Draw
    tick: Array  # [] int, control ticks so far


class Course(NamedTuple):
    """The three parts of a run."""

    begin: Callable[[Values, Array, Array], Place]  # (values, policy [15], key)
    look: Callable[[Values, Array, Place], tuple[Place, Signal, episode.Row]]
    # reads the sensors and asks the pilot: what it commands, and the row
    move: Callable[[Values, Place, Signal], Place]  # plays a command for one tick


def course(world: World, engine: Engine) -> Course:
    """Return the parts of a run of one robot in a world."""
    where, servos = find_slots(world.model), actuation(world)

    def begin(values: Values, policy: Array, key: Array) -> Place:
        drawn = episode.draw(world.task, policy, key)
        data = engine.begin(*episode.placed(world.model, where, drawn))
        plant, pilot = engine.see(data), tasks.begin(policy)
        loop, first = episode.open_loop(world, values, drawn, pilot, plant)
        return Place(loop, data, servos.init(values, first), drawn, jnp.int32(0))

    def look(
        values: Values, policy: Array, place: Place
    ) -> tuple[Place, Signal, episode.Row]:
        drawn, plant = place.drawn, engine.see(place.data)
        angle = servos.seen(values, place.servos, plant.reading.angle)
        plant = plant._replace(reading=plant.reading._replace(angle=angle))
        noise = episode.noise(drawn.noise, place.tick)
        loop, reading = episode.sense(
            world, values, drawn, noise, place.loop, place.tick, plant
        )
        pilot, target = tasks.pilot(world.task, policy, drawn.go, loop.pilot, reading)
        row = episode.Row(target, reading, plant.base, loop.score.alive)
        signal = episode.asked(world, plant, row, noise)
        place = place._replace(loop=loop._replace(pilot=pilot), tick=place.tick + 1)
        return place, signal, row

    def move(values: Values, place: Place, signal: Signal) -> Place:
        command, told = world.chains()[0].apply(
            values.command, place.loop.command, signal
        )
        data, state = engine.advance(values, place.data, place.servos, told.target)
        loop = place.loop._replace(command=command)
        return place._replace(loop=loop, data=data, servos=state)

    return Course(begin, look, move)
