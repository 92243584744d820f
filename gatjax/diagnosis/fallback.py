"""What to do about a misfit without a name: a learned correction of the commands.

GAT (Hanna & Stone 2017, Algorithm 1) on the extended world: f from the logs, f_sim^-1
from what that world does with the same commands and a dither. Both learn from the first
part of each log; alpha is the one with which the rest of the log is predicted best.

Without the dither f_sim^-1 would not learn physics: smooth commands can be extrapolated
from their past, which is what a network finds first.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from gatjax.data.trajectories import JointRun
from gatjax.diagnosis import learned, measure
from gatjax.grounding.gat import Gat, learn_forward, learn_inverse
from gatjax.grounding.learn import Grounding, grounded, with_alpha, write_grounding
from gatjax.robot.model import joint_names
from gatjax.sim.stored import write_world
from gatjax.sim.world import World

LEARNED = 0.7  # of each log; the rest chooses alpha
DITHER, COPIES = 0.03, 4  # rad, of each command; times that the logs are played with it
ALPHAS = (0.0, 0.2, 0.4, 0.6, 0.8, 1.0)
FOLDER = "learned"
FILES = ("world.json", "grounder.json", "weights.npz")


def learn(world: World, logs: list[JointRun], seed: int) -> Grounding:
    """Learn a correction of what a world gets wrong.

    Args:
        world: fixed base, at the control period of the logs.
        logs: that it was fitted to.
        seed: of initial weights and splits.

    Returns:
        GAT on all joints, with its alpha; 0 if it makes every prediction worse.
    """
    early = [run.part(np.arange(_split(run))) for run in logs]
    forward, forward_fit = learn_forward(learned.pieces(early), seed)
    simulated = learned.pieces(_simulated(world, early, seed))
    inverse, inverse_fit = learn_inverse(simulated, seed + 1)
    facts = {"forward": forward_fit._asdict(), "inverse": inverse_fit._asdict()}
    found = Grounding(
        "gat", Gat(np.float32(1.0), forward, inverse),
        facts | {"rate_hz": world.rate_hz}, joint_names(world.model),
    )  # fmt: skip
    tried = [with_alpha(found, alpha) for alpha in ALPHAS]
    errors = _late_errors([grounded(world, each) for each in tried], logs)
    return tried[int(np.argmin(np.where(np.isfinite(errors), errors, np.inf)))]


def _simulated(world: World, logs: list[JointRun], seed: int) -> list[JointRun]:
    """What a world does with the commands of logs, dithered."""
    draw = np.random.default_rng(seed)
    told = [
        run._replace(command=run.command + DITHER * draw.normal(size=run.command.shape))
        for run in logs * COPIES
    ]
    pairs = zip(told, measure.whole_log(world, told), strict=True)
    return [run._replace(angle=angle) for run, angle in pairs]


def _split(run: JointRun) -> int:
    """Rows of a run that are learned from."""
    return round(LEARNED * len(run.time))


def _late_errors(worlds: list[World], logs: list[JointRun]) -> np.ndarray:
    """Mean squared errors [W], rad^2, of the rows that were not learned from.

    The worlds differ in values only, so that one batch plays all of them.
    """
    values = [world.values for world in worlds for _ in logs]
    played = measure.whole_log(worlds[0], logs * len(worlds), values)
    late = [
        np.square(angle - run.angle)[_split(run) :].mean()
        for run, angle in zip(logs * len(worlds), played, strict=True)
    ]
    return np.mean(np.reshape(late, (len(worlds), -1)), axis=1)


def withdraw(out: Path) -> None:
    """Remove what an earlier diagnosis offered."""
    for name in FILES:
        (out / FOLDER / name).unlink(missing_ok=True)


def offer(
    out: Path, world: World, logs: list[JointRun], unseen: list[JointRun], seed: int
) -> dict[str, Any]:
    """Learn a correction, measure its gain, and write the world that has it.

    It is written unless held-out logs do not bear it out.

    Args:
        out: gets learned/: a world file and its grounding.
        world: the extended one.
        logs: that were explained.
        unseen: held-out; may be empty.
        seed: of everything that is drawn.

    Returns:
        `fallback` of diagnosis.json (docs/files.md).
    """
    grounding = learn(world, logs, seed)
    alpha = grounding.facts["alpha"]
    row: dict[str, Any] = {"method": "gat", "alpha": alpha, "world": None}
    if alpha > 0.0 and unseen:
        row |= _gain(world, grounding, unseen)
    if alpha > 0.0 and row.get("promoted", True):
        write_grounding(out / FOLDER, grounding)
        made_by = {"verb": "diagnose", "seed": seed}
        write_world(out / FOLDER / "world.json", world, made_by, ".")
        row["world"] = f"{FOLDER}/world.json"
    return row


def _gain(world: World, grounding: Grounding, unseen: list[JointRun]) -> dict[str, Any]:
    """Errors on held-out logs without and with a correction, as in `gain`."""
    errors = measure.log_errors(
        unseen,
        {
            "before": measure.whole_log(world, unseen),
            "after": measure.whole_log(grounded(world, grounding), unseen),
        },
    )
    low, high = measure.interval(errors["before"], errors["after"], None)
    sizes = {key: float(np.sqrt(e.squared.mean())) for key, e in errors.items()}
    return sizes | {"low": low, "high": high, "promoted": bool(low > 0.0)}
