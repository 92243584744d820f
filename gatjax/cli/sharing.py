"""Searches on several hosts: what the leader tells them, and what they make of it."""

from __future__ import annotations

import contextlib
import json
import platform
import sys
import tempfile
from collections.abc import Iterator
from importlib.metadata import version
from pathlib import Path, PurePosixPath
from typing import Any

import jax
import numpy as np

from gatjax import loop
from gatjax.cli.arguments import Search, Work
from gatjax.cli.inputs import walker_of
from gatjax.cli.resume import GROUNDING
from gatjax.hosts import Crew, Task
from gatjax.hosts.crew import Run
from gatjax.loop.memory import frugal
from gatjax.loop.steps import Share, physics, searched, unshared
from gatjax.ranking import Evaluate
from gatjax.robot.model import SHIPPED
from gatjax.settings import LoopSettings
from gatjax.sim.backend import costs, prepare
from gatjax.sim.stored import model_files, world_file
from gatjax.task import task_at

Array = Any
SAME = ("gatjax", "mujoco")  # packages of which all hosts need the same version
WAIT = 300.0  # s for hosts that are asked for
WORLD, MODEL, LEARNED = "world.json", "model", "grounding"


def say(text: str) -> None:
    """Show a line beside the progress."""
    print(f"gatjax: {text}", file=sys.stderr, flush=True)


@contextlib.contextmanager
def opened(verb: Search, left: int) -> Iterator[Share]:
    """Let other hosts join a search while the block runs, if it listens.

    Args:
        verb: what was asked for.
        left: generations that are left to do; without any nobody is waited for.

    Raises:
        ValueError: one line: flags that do not fit, or the port can not be had.
    """
    if verb.listen is None:
        if verb.hosts:
            raise ValueError("--hosts is for --listen PORT, where others join")
        yield unshared
        return
    if not 0 <= verb.listen < 65536 or not 0 <= verb.hosts < verb.population:
        raise ValueError(
            f"--listen is a port up to 65535, --hosts less than the population "
            f"({verb.population}): a host without a policy has nothing to do"
        )
    crew = Crew(verb.listen, _told(verb), say)
    say(f"listens: gatjax work --leader {platform.node()}:{crew.port}")
    done = False
    try:
        crew.wait(verb.hosts if left else 0, WAIT)
        yield _shared(crew)
        done = True
    finally:
        crew.close(done)


def _told(verb: Search) -> Task:
    """What a search tells hosts that join."""
    world = walker_of(verb.world, task_at(verb.rate_hz))
    facts = {
        "versions": {name: version(name) for name in SAME},
        "model": verb.model,
        "rate_hz": verb.rate_hz,
        "simulator": physics(searched(LoopSettings(model=verb.model), world)),
    }
    return Task(facts, {} if verb.world is None else _files(verb.world))


def _shared(crew: Crew) -> Share:
    """Spread what evaluates policies over the hosts of a crew."""

    def share(evaluate: Evaluate) -> Evaluate:
        def every(values: Any, policies: Array, keys: Array) -> Array:
            words = np.asarray(jax.random.key_data(keys))
            return crew.evaluate(_run(evaluate, values), np.asarray(policies), words)

        return every

    return share


def prepared(task: Task, verb: Work) -> Run:
    """Return what runs a leader's policies on this host.

    Raises:
        ValueError: one line: it can not be done here.
    """
    ours = {name: version(name) for name in SAME}
    if task.facts["versions"] != ours:
        raise ValueError(f"the leader has {task.facts['versions']}, this host {ours}")
    with tempfile.TemporaryDirectory() as folder:
        _unpack(task.files, Path(folder))
        path = Path(folder) if task.files else None
        world = walker_of(path, task_at(task.facts["rate_hz"]))
        settings = loop.resolved(
            LoopSettings(
                model=task.facts["model"], backend=verb.backend, impl=verb.impl
            )
        )
        world = searched(settings, world)  # reads the model again
        here = physics(world)
    theirs = task.facts["simulator"]
    if here != theirs:
        raise ValueError(
            f"the leader simulates with {theirs}, this host with {here}; install the "
            f"same gatjax on both"
        )

    def build(turns: int) -> Run:
        backend = prepare(world, settings.backend, settings.impl, turns)
        return _run(costs(backend), world.values)

    return frugal(build, lambda policies, words: len(policies) * len(words), say)


def _run(evaluate: Evaluate, values: Any) -> Run:
    """Policies and words of keys -> costs."""

    def run(policies: Array, words: Array) -> np.ndarray:
        return np.asarray(evaluate(values, policies, jax.random.wrap_key_data(words)))

    return run


def _files(path: Path) -> dict[str, bytes]:
    """A world's files under names of their own."""
    path = world_file(path)
    text = json.loads(path.read_text(encoding="utf-8"))
    files = {}
    if text["model"] not in SHIPPED:
        name, parts = model_files(path.parent.resolve() / text["model"])
        files = {f"{MODEL}/{part}": file.read_bytes() for part, file in parts.items()}
        text["model"] = f"{MODEL}/{name}"
    if text.get("grounding"):
        for name in GROUNDING:
            file = path.parent / text["grounding"] / name
            files[f"{LEARNED}/{name}"] = file.read_bytes()
        text["grounding"] = LEARNED
    return files | {WORLD: json.dumps(text).encode()}


def _unpack(files: dict[str, bytes], folder: Path) -> None:
    """Write a world's files; others are not asked for, wherever they would go."""
    asked = (WORLD, *(f"{LEARNED}/{part}" for part in GROUNDING))
    for name, data in files.items():
        first, *rest = PurePosixPath(name).parts
        below = first == MODEL and rest and ".." not in rest
        if name in asked or below:
            file = folder / name
            file.parent.mkdir(parents=True, exist_ok=True)
            file.write_bytes(data)
