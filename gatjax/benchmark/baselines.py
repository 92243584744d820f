"""What simpler methods say, on the same single-joint simulations.

    python -m gatjax.benchmark.baselines --model M.xml --data F.. --held-out H.. --out D

Three methods, each an answer in the schema of diagnosis.json: the single hypothesis
with the largest improvement (always named if there is any), the same where BIC
(Schwarz 1978) prefers it to the nominal model, and all numbers of all joints fitted at
once, of which the largest change is named if it is above three tolerances.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from gatjax.benchmark import everything
from gatjax.benchmark.squares import Solved, nominal, solved
from gatjax.data.recording import check_recording, read_recording
from gatjax.data.trajectories import to_arrays
from gatjax.diagnosis import case as cases
from gatjax.diagnosis import fit as fits
from gatjax.diagnosis.bank import CAUSES
from gatjax.diagnosis.hypotheses import COUNT, Hypothesis
from gatjax.diagnosis.joint import Joint
from gatjax.effects.catalogue import CATALOGUE
from gatjax.robot import model as robot_model
from gatjax.runs import write_json
from gatjax.sim.backend import use_compile_cache

SCHEMA = "gatjax.bench.baselines/1"
IMPROVEMENT, BIC, EVERYTHING = "largest improvement", "BIC", "fit everything"
ROUNDS = 6  # of Gauss-Newton for a hypothesis at one joint
SHARED_ROUNDS = 2  # for one value at all joints, from the median of the single ones
BODY = ("payload", "com_shift")  # are about one link


class Problem(NamedTuple):
    """Joints with the rows to fit, and the same with the held-out rows."""

    fit: list[Joint]
    held: list[Joint]  # empty without held-out logs


class Found(NamedTuple):
    """A fitted hypothesis and the joints (by number) that share it."""

    solved: Solved
    where: tuple[int, ...]


def problem(model: str, fit: Sequence[str], held: Sequence[str], seed: int) -> Problem:
    """Make the joints of a case ready; loads are weighed along all of its runs."""
    loaded = robot_model.load(model)
    joints = robot_model.joint_names(loaded)
    runs, seen = [], []
    for paths, is_fit in ((fit, True), (held, False)):
        for path in paths:
            recording = read_recording(path)
            check_recording(recording, joints)
            cut = to_arrays(recording, joints)
            runs += cut
            seen += [is_fit] * len(cut)
    base = cases.held(loaded, runs, seed)
    case = cases.settled(cases.prepare(base, runs, _silent), _silent)
    rows = np.array(seen)[:, None]
    parts = [
        [joint._replace(valid=joint.valid & mask) for joint in case.joints]
        for mask in (rows, ~rows)
    ]
    return Problem(parts[0], parts[1] if held else [])


def _silent(stage: str, share: float) -> None:
    """Show no progress."""


def everywhere(cause: str) -> bool:
    """Whether a cause is always about the whole robot."""
    return CATALOGUE[cause].place == "all"


def _begins(joint: Joint) -> list[list[np.ndarray]]:
    """Where each cause starts at a joint."""
    rest = fits.residuals(joint, [(None, np.zeros(COUNT))])[:, 0]
    return [[np.array(s) for s in h.begins(joint, rest)] for h in CAUSES]


def weighed(given: Problem) -> list[Found]:
    """Fit every cause of the catalogue at each joint, and with one value at all."""
    single = [solved([joint], CAUSES, _begins(joint), ROUNDS) for joint in given.fit]
    out = [
        Found(each, (index,))
        for index, row in enumerate(single)
        for each in row
        if len(given.fit) == 1 or not everywhere(each.hypothesis.cause)
    ]
    if len(given.fit) == 1:
        return out
    every = tuple(range(len(given.fit)))
    bank = [h for h in CAUSES if h.cause not in BODY]
    middle = [
        [np.median([row[CAUSES.index(h)].own for row in single], axis=0)] for h in bank
    ]
    shared = solved(given.fit, bank, middle, SHARED_ROUNDS)
    return out + [Found(each, every) for each in shared]


def improvement(found: Found, before: np.ndarray) -> float:
    """Squares that a hypothesis takes away, rad^2."""
    return float(before[list(found.where)].sum() - found.solved.squares.sum())


def bic(found: Found, before: np.ndarray, counts: np.ndarray) -> float:
    """BIC of the nominal model minus that of a hypothesis; positive: prefer it."""
    where = list(found.where)
    ratio = before[where] / np.maximum(found.solved.squares, 1e-12)
    price = len(found.solved.own) * np.log(counts.sum())
    return float(counts[where] @ np.log(ratio) - price)


def answers(given: Problem) -> dict[str, dict[str, Any]]:
    """What each method says of a case."""
    begun = time.monotonic()
    before = np.array([nominal(joint) for joint in given.fit])
    counts = np.array([int(joint.valid.sum()) for joint in given.fit])
    found = weighed(given)
    single = time.monotonic() - begun
    out = {}
    for name, gains in (
        (IMPROVEMENT, [improvement(f, before) for f in found]),
        (BIC, [bic(f, before, counts) for f in found]),
    ):
        best = int(np.argmax(gains))
        chosen = found[best] if gains[best] > 0.0 else None
        out[name] = said(given, chosen) | {"seconds": round(single, 1)}
    begun = time.monotonic()
    fitted = everything.fitted(given.fit)
    row = everything.named(given.fit, fitted)
    points = [(each.hypothesis, each.own) for each in fitted]
    seconds = round(time.monotonic() - begun, 1)
    gain = held_gain(given, dict(enumerate(points)))
    out[EVERYTHING] = _answer(row, gain) | {"seconds": seconds}
    return out


def said(given: Problem, found: Found | None) -> dict[str, Any]:
    """An answer that names one hypothesis, or none."""
    if found is None:
        return _answer(None, held_gain(given, {}))
    one = found.solved
    joint = given.fit[found.where[0]]
    names = [given.fit[k].name for k in found.where]
    whole = len(names) == len(given.fit) > 1 or everywhere(one.hypothesis.cause)
    row = {
        "cause": one.hypothesis.cause,
        "where": ["all"] if whole else names,
        "parameters": parameters(joint, one),
        "probability": 1.0,
        "equivalent": [],
    }
    points = {k: (one.hypothesis, one.own) for k in found.where}
    return _answer(row, held_gain(given, points))


def parameters(joint: Joint, one: Solved) -> dict[str, dict[str, Any]]:
    """The scored parameter with its 90 % interval, SI."""
    entry = CATALOGUE[one.hypothesis.cause].parameters[0]
    low, high = np.asarray(one.hypothesis.low), np.asarray(one.hypothesis.high)
    ends = [
        one.hypothesis.values(joint, np.clip(one.own + k * one.deviation, low, high))
        for k in (-1.645, 0.0, 1.645)
    ]
    values = [float(end[entry.name]) for end in ends if entry.name in end]
    if len(values) < 3:
        return {}
    spread = {"low": min(values), "high": max(values), "unit": entry.unit}
    return {entry.name: {"value": values[1], **spread}}


def held_gain(
    given: Problem, points: dict[int, tuple[Hypothesis, np.ndarray]]
) -> dict[str, float] | None:
    """Held-out error of all joints before and after, rad rms; None without logs."""
    if not given.held:
        return None
    before = np.array([nominal(joint) for joint in given.held])
    after = before.copy()
    for index, (hypothesis, own) in points.items():
        point = (hypothesis, np.append(np.zeros(COUNT), own))
        after[index] = fits.squares(given.held[index], point)
    count = sum(int(joint.valid.sum()) for joint in given.held)
    return {
        "before": float(np.sqrt(before.sum() / count)),
        "after": float(np.sqrt(after.sum() / count)),
    }


def _answer(row: dict[str, Any] | None, gain: dict[str, float] | None) -> dict:
    """An answer in the schema of diagnosis.json."""
    causes = [] if row is None else [row]
    return {"verdict": "named" if causes else "none", "causes": causes, "gain": gain}


def main() -> int:
    """Answer one case as the command line says."""
    parser = argparse.ArgumentParser(prog="gatjax.benchmark.baselines")
    parser.add_argument("--model", required=True)
    parser.add_argument("--data", nargs="+", required=True)
    parser.add_argument("--held-out", nargs="*", default=[])
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--seed", type=int, default=0)
    given = parser.parse_args()
    use_compile_cache()
    ready = problem(given.model, given.data, given.held_out, given.seed)
    tree = {"schema": SCHEMA, "answers": answers(ready)}
    write_json(given.out / "baselines.json", tree)
    return 0


if __name__ == "__main__":
    sys.exit(main())
