"""What a misfit without a name depends on, and a term that could stand for it.

The misfit of a joint is turned into a torque by the linear servo (I r'' + D r' + kp r),
and regressed on what the torque could depend on. Shares are measured on seconds that
the regression has not seen; the term is a forward selection (a sparse regression,
Efroymson 1960) that stops when unseen seconds no longer gain.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from gatjax.data.recording import Recording
from gatjax.data.trajectories import Columns, cut_columns
from gatjax.diagnosis import measure
from gatjax.diagnosis.case import Case
from gatjax.diagnosis.fit import Fit
from gatjax.diagnosis.hypotheses import COUNT, numbers
from gatjax.diagnosis.joint import Joint
from gatjax.diagnosis.motion import smoothed

MOST = 3  # parts of a term
WORTHWHILE = 0.05  # share of the torque's power that another part must add
SHOWN = 5  # variables in the result
CONDITIONS = ("temperature", "voltage")  # columns of a recording
FREQUENCIES = np.geomspace(0.1, 6.0, 60)  # Hz


class Feature(NamedTuple):
    """Something that a torque may depend on."""

    variable: str
    text: str  # as it stands in a term
    series: np.ndarray  # [n]


def conditions(recordings: Sequence[Recording]) -> list[Columns]:
    """Temperatures and voltage, less their mean, where all recordings have them.

    Returns:
        Column name -> [N], one dict for each trajectory, as `to_arrays` orders them.
    """
    shared = set.intersection(*(set(each.columns) for each in recordings))
    names = [
        c for c in sorted(shared) if c.partition(".")[0] in CONDITIONS
        and all(np.isfinite(each.columns[c]).all() for each in recordings)
    ]  # fmt: skip
    mean = {c: np.mean([r.columns[c].mean() for r in recordings]) for c in names}
    return [
        {c: values - mean[c] for c, values in run.items()}
        for each in recordings
        for run in cut_columns(each, names)
    ]


def explore(
    case: Case, joint: Joint, fit: Fit, beside: list[Columns]
) -> dict[str, Any]:
    """Variables with their shares, and a term, for the misfit of a joint.

    Args:
        case: that the joint is of.
        joint: with a misfit.
        fit: that leaves it.
        beside: `conditions` of the recordings.
    """
    torque, block, features = _series(case, joint, fit, beside)
    groups: dict[str, list[Feature]] = {}
    for feature in features:
        groups.setdefault(feature.variable, []).append(feature)
    shares = {
        name: _unseen_share(torque, [f.series for f in some], block)
        for name, some in groups.items()
    }
    ranked = sorted(shares.items(), key=lambda item: -item[1])[:SHOWN]
    return {
        "depends_on": [
            {"variable": name, "share": round(share, 3)}
            for name, share in ranked if share > WORTHWHILE
        ],
        "term": _term(joint, torque, features, block),
    }  # fmt: skip


def _series(
    case: Case, joint: Joint, fit: Fit, beside: list[Columns]
) -> tuple[np.ndarray, np.ndarray, list[Feature]]:
    """Misfit torque [n], its second [n], and the features of all runs together."""
    drive = joint.nominal | numbers(joint, None, fit.x[:COUNT])
    torque, block, columns, start = [], [], [], 0
    for number, (run, motion, load) in enumerate(
        zip(case.runs, case.motions, case.loads, strict=True)
    ):
        time = run.time - run.time[0]
        valid = joint.valid[number, : len(time)]
        if not valid.any():
            continue  # left aside
        rest = fit.residual[start : start + valid.sum()]
        start += len(rest)
        found = smoothed(run, np.interp(time, time[valid], rest)[:, None], time)
        inertia = np.interp(time, motion.time, load.nominal.inertia[:, joint.index])
        stiff = run.stiff[:, joint.index]
        damping = drive["kv"] * (stiff > 0.0) + drive["damping"]
        spring = drive["kp"] * drive["hold"] * stiff
        if "pull" in drive:  # what draws it to the measured motion holds it as well
            spring = spring + inertia * drive["steer"] + damping * drive["pull"]
            damping = damping + inertia * drive["pull"]
        torque.append(
            inertia * found.acceleration[:, 0]
            + damping * found.velocity[:, 0]
            + spring * found.position[:, 0]
        )
        block.append(number * measure.APART + time.astype(int))
        columns.append(_features(case, joint, number, time, beside[number]))
    features = [
        same[0]._replace(series=np.concatenate([f.series for f in same]))
        for same in zip(*columns, strict=True)
    ]
    return np.concatenate(torque), np.concatenate(block), features


def _features(
    case: Case, joint: Joint, run: int, time: np.ndarray, beside: Columns
) -> list[Feature]:
    """What the torque of a joint may depend on, in one run."""
    motion, load = case.motions[run], case.loads[run].nominal
    j = joint.index

    def at(series: np.ndarray) -> np.ndarray:
        return np.interp(time, motion.time, series)

    q, v = at(motion.position[:, j]), at(motion.velocity[:, j])
    weight = at(load.rest[:, j])
    direction = np.tanh(v / 0.05)
    out = [Feature("position", f"q^{n}" if n > 1 else "q", q**n) for n in (1, 2, 3)]
    out += [
        Feature("velocity", "v", v), Feature("velocity", "|v| v", np.abs(v) * v),
        Feature("velocity", "sgn v", direction), Feature("velocity", "|v|", np.abs(v)),
        Feature("position and direction", "q sgn v", q * direction),
        Feature("position and direction", "q^2 sgn v", q**2 * direction),
        Feature("load", "load", weight),
        Feature("load", "|load| sgn v", np.abs(weight) * direction),
        Feature("time", "t", time),
    ]  # fmt: skip
    for name, series in beside.items():
        if name.partition(".")[2] in ("", joint.name):
            out += [
                Feature(name, name, series), Feature(name, f"{name} v", series * v),
                Feature(name, f"{name} sgn v", series * direction),
            ]  # fmt: skip
    for hertz in FREQUENCIES:
        phase = 2.0 * np.pi * hertz * time
        name = f"time at {hertz:.2g} Hz"
        out.append(Feature(name, f"sin(2 pi {hertz:.2g} t)", np.sin(phase)))
        out.append(Feature(name, f"cos(2 pi {hertz:.2g} t)", np.cos(phase)))
    for other in case.joints:
        if other.index != j:
            k, name = other.index, other.name
            out += [
                Feature(f"joint {name}", f"q({name})", at(motion.position[:, k])),
                Feature(f"joint {name}", f"v({name})", at(motion.velocity[:, k])),
                Feature(f"joint {name}", f"load({name})", at(load.rest[:, k])),
            ]
    return out


def _unseen_share(torque: np.ndarray, columns: list, block: np.ndarray) -> float:
    """Share of the torque's power that a linear model explains on unseen seconds."""
    matrix = np.stack([*columns, np.ones_like(torque)], -1)
    left = 0.0
    for half in (0, 1):
        seen = (block // 2) % 2 == half
        if seen.all() or not seen.any():
            return 0.0
        weights = np.linalg.lstsq(matrix[seen], torque[seen], rcond=1e-8)[0]
        left += float(np.square(torque[~seen] - matrix[~seen] @ weights).sum())
    total = float(np.square(torque - torque.mean()).sum())
    return max(0.0, 1.0 - left / max(total, 1e-18))


def _term(
    joint: Joint, torque: np.ndarray, features: list[Feature], block: np.ndarray
) -> str | None:
    """A short sum that explains the misfit torque, or None."""
    chosen: list[Feature] = []
    best = 0.0
    while len(chosen) < MOST:
        tries = [
            (_unseen_share(torque, [c.series for c in (*chosen, f)], block), n)
            for n, f in enumerate(features)
        ]
        share, number = max(tries)
        if share < best + WORTHWHILE:
            break
        best = share
        chosen.append(features[number])
    if not chosen:
        return None
    matrix = np.stack([*(f.series for f in chosen), np.ones_like(torque)], -1)
    weights = np.linalg.lstsq(matrix, torque, rcond=1e-8)[0]
    parts = [f"{w:+.3g} {f.text}" for w, f in zip(weights, chosen, strict=False)]
    parts.append(f"{weights[-1]:+.2g}")
    return f"torque at {joint.name} = {' '.join(parts)} N*m ({best:.0%} of the misfit)"
