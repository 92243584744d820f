"""Going on: a command that goes on with a folder must ask for what is in it."""

from __future__ import annotations

import dataclasses
import hashlib
import json
from pathlib import Path
from typing import Any

import numpy as np

from gatjax import checkpoints, loop, runs
from gatjax.cli.arguments import Run, Search
from gatjax.robot.model import SHIPPED
from gatjax.settings import LoopSettings, SearchSettings
from gatjax.sim.stored import model_files, world_file
from gatjax.walk.parameters import PARAMETERS

SEARCH = "gatjax.search/1"
GROUNDING = ("grounder.json", "weights.npz")


def settings_of(config: dict[str, Any], folder: Path) -> LoopSettings:
    """Rebuild loop settings from config.json."""
    try:
        search = SearchSettings(**config["search"])
        whole: dict[str, Any] = config | {"search": search}
        for name in ("methods", "candidates"):
            whole[name] = tuple(config[name])
        return LoopSettings(**whole)
    except (KeyError, TypeError) as error:
        raise ValueError(
            f"{folder}: config.json is not that of a run of this version ({error})"
        ) from error


def resumed(verb: Run) -> tuple[Path, LoopSettings]:
    """Open the run that --resume means; refuse flags that ask for another one.

    Raises:
        FileNotFoundError: there is no such run.
        ValueError: one line with the first setting that differs.
    """
    folder = runs.resume_run(verb.run or runs.latest_run(verb.out))
    settings = settings_of(folder.config, folder.path)
    if verb.typed:
        asked, own = _flat(loop.resolved(verb.loop)), _flat(settings)
        # A preset is all of its settings; `typed` names those that it does not decide.
        names = list(own) if "preset" in verb.typed else list(verb.typed)
        runs.check_same(
            {name: own[name] for name in names},
            {name: asked[name] for name in names},
            folder.path,
        )
    return folder.path, settings


def _flat(settings: LoopSettings) -> dict[str, Any]:
    """Every setting by the name of its flag."""
    tree = dataclasses.asdict(settings)
    return tree | tree.pop("search")


def open_search(verb: Search, chosen: LoopSettings, theta: np.ndarray) -> int:
    """Write what a search is into its folder; refuse a folder of another search.

    Generations are left out of the comparison: asking for more is how a search goes on.

    Returns:
        Generations that are left to do.

    Raises:
        ValueError: one line with the first fact that differs.
    """
    asked = {
        "schema": SEARCH,
        "world": None if verb.world is None else world_digest(verb.world),
        "policy": {
            parameter.name: float(value)
            for parameter, value in zip(PARAMETERS, theta, strict=True)
        },
        "seed": verb.seed,
        "rate_hz": verb.rate_hz,
        "model": chosen.model,
        "backend": chosen.backend,
        "impl": chosen.impl,
        "search": dataclasses.asdict(chosen.search),
    }
    file = verb.out / "config.json"
    done = checkpoints.latest(verb.out / "checkpoints" / "search_0")
    if file.exists():
        there = runs.read_json(file)
        if there.get("schema") != SEARCH:
            raise ValueError(f"{verb.out}: not a search folder; choose another --out")
        if done is not None:
            runs.check_same(_endless(there), _endless(asked), verb.out)
    elif done is not None:
        raise ValueError(
            f"{verb.out}: holds a search without config.json, of an unknown world; "
            f"choose another --out"
        )
    if done is not None and done + 1 > chosen.search.generations:
        raise ValueError(
            f"{verb.out}: has {done + 1} generations already; ask for as many or more, "
            f"or choose another --out"
        )
    (verb.out / "policies").mkdir(parents=True, exist_ok=True)
    runs.write_json(file, asked)
    return chosen.search.generations - (0 if done is None else done + 1)


def _endless(config: dict[str, Any]) -> dict[str, Any]:
    """Leave the number of generations out."""
    search = {k: v for k, v in config["search"].items() if k != "generations"}
    return config | {"search": search}


def world_digest(path: Path) -> str:
    """Sixteen characters that change with a world: its file, model and grounding."""
    path = world_file(path)
    text = json.loads(path.read_text(encoding="utf-8"))
    files = [path]
    if text["model"] not in SHIPPED:
        files += model_files(path.parent / text["model"])[1].values()
    if text.get("grounding"):
        files += [path.parent / text["grounding"] / name for name in GROUNDING]
    digest = hashlib.sha256()
    for file in files:
        digest.update(hashlib.sha256(file.read_bytes()).digest())
    return digest.hexdigest()[:16]
