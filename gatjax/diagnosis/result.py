"""diagnosis.json: what a diagnosis found, in the words of the contract."""

from __future__ import annotations

from typing import Any

import numpy as np

from gatjax.data.trajectories import JointRun
from gatjax.diagnosis import extend, patterns
from gatjax.diagnosis.claims import Claim
from gatjax.diagnosis.excerpt import source
from gatjax.diagnosis.fit import LEFT
from gatjax.diagnosis.hypotheses import COUNT, numbers
from gatjax.diagnosis.sentence import sentence
from gatjax.diagnosis.unexplained import explore
from gatjax.diagnosis.verdict import Cause, Verdict
from gatjax.effects.catalogue import CATALOGUE

SCHEMA = "gatjax.diagnosis/1"
DRAWS = 48  # of a cause's coordinates, for its interval
MODEL_ERROR = 0.12  # of a cause's size: its law is a simplification of the robot's
UNITS = {"no_torque_speed": "rad/s"}
NUMBERS = {
    "kv": "N*m*s/rad", "damping": "N*m*s/rad", "armature": "kg*m^2", "limit": "N*m",
    "friction": "N*m",
}  # fmt: skip
"""Of nominal numbers that are calibrated; that of kp depends on the drive."""
ZEROS = {"zero_out": "encoder zero", "zero_in": "encoder zero, seen by the servo"}


def interval(verdict: Verdict, claim: Claim, seed: int) -> dict[str, dict[str, Any]]:
    """Parameters with their 90 % intervals, from draws of the coordinates."""
    best = extend.parameters(verdict.judge, claim)
    entry = CATALOGUE[claim.hypothesis.cause]
    units = _units(claim)
    draws = {name: [value] for name, value in best.items()}
    if claim.stance is not None:
        draws[entry.main.name] += [claim.stance.low, claim.stance.high]
    elif claim.covariance is not None and len(claim.own):
        low, high = np.array(claim.hypothesis.low), np.array(claim.hypothesis.high)
        noise = np.random.default_rng(seed).normal(size=(DRAWS, len(claim.own)))
        root = np.linalg.cholesky(claim.covariance + 1e-18 * np.eye(len(claim.own)))
        for row in noise:
            own = np.clip(claim.own + root @ row, low, high)
            drawn = extend.parameters(verdict.judge, claim._replace(own=own))
            for name, value in drawn.items():
                draws[name].append(value)
    elif claim.lost:
        draws["probability"] += patterns.within(*extend.pattern(verdict.judge, claim))
    out = {}
    for name, value in best.items():
        low_value, high_value = np.quantile(draws[name], (0.05, 0.95))
        if (claim.lost or claim.stance) and name == entry.main.name:
            low_value, high_value = min(draws[name]), max(draws[name])
        if name == entry.main.name:
            error = MODEL_ERROR * abs(entry.size(value))
            within = entry.main.low <= value <= entry.main.high
            least, most = (
                (entry.main.low, entry.main.high) if within else (-np.inf, np.inf)
            )
            low_value = min(low_value, max(value - error, least))
            high_value = max(high_value, min(value + error, most))
        out[name] = {
            "value": value, "low": float(min(low_value, value)),
            "high": float(max(high_value, value)), "unit": units.get(name, "1"),
        }  # fmt: skip
    return out


def told(
    verdict: Verdict, logs: list[str], whole: list[JointRun],
    beside: list[dict[str, np.ndarray]], seed: int,
) -> dict[str, Any]:  # fmt: skip
    """What diagnosis.json says of a verdict.

    Args:
        verdict: of the diagnosis.
        logs: name of the log of each run.
        whole: the runs that they are, or are pieces of.
        beside: `unexplained.conditions` of the recordings that were explained.
        seed: of the intervals.
    """
    rows, aside = cause_rows(verdict, seed), left_aside(verdict, logs, whole)
    return {
        "schema": SCHEMA,
        "verdict": verdict.verdict,
        "sentence": sentence(verdict, rows, aside),
        "causes": rows,
        "unexplained": unexplained(verdict, beside),
        "joints": joint_rows(verdict),
        "left_aside": aside,
        "signals": verdict.judge.signals(),
        "calibration": calibration_rows(verdict),
        "candidates": candidates(verdict),
    }


def cause_rows(verdict: Verdict, seed: int) -> list[dict[str, Any]]:
    """The entries of `causes`: one for each value, however it is shared."""
    return [
        cause_row(verdict, cause._replace(claim=piece), seed)
        for cause in verdict.causes
        for piece in extend.pieces(verdict.judge, cause.claim)
    ]


def cause_row(verdict: Verdict, cause: Cause, seed: int) -> dict[str, Any]:
    """One entry of `causes`."""
    return {
        "cause": cause.claim.hypothesis.cause,
        "variant": cause.claim.hypothesis.variant,
        "where": extend.places(verdict.judge, cause.claim),
        "parameters": interval(verdict, cause.claim, seed),
        "probability": round(cause.probability, 4),
        "borne_out": cause.borne_out,
        "equivalent": cause.equivalent,
        "log_evidence": round(cause.claim.gain, 1),
    }


def candidates(verdict: Verdict) -> list[dict[str, Any]]:
    """Everything that was weighed, one cause after the other, best first.

    A cause with several values was weighed once, in the step of the first of them; the
    values themselves are told with the cause.
    """
    rows: list[dict[str, Any]] = []
    groups: dict[int, list[tuple[int, Cause]]] = {}
    for number, cause in enumerate(verdict.causes, start=1):
        groups.setdefault(id(cause.rivals), []).append((number, cause))
    for (number, cause), *rest in groups.values():
        others = [other for _, other in rest]
        gain = cause.claim.gain + sum(other.claim.gain for other in others)
        where = sum((other.claim.where for other in others), cause.claim.where)
        first = cause.claim._replace(gain=gain, where=where)
        everything = [(first, cause.probability), *cause.rivals]
        for claim, probability in everything:
            row = _candidate(verdict, claim) | {"probability": round(probability, 4)}
            if others and claim is first:
                row |= {"parameters": {}, "rms": None}  # no one value or joint
            rows.append(row | {"step": number})
    if len(verdict.causes) == verdict.judge.most:
        return rows  # nothing was weighed after these
    law = [] if verdict.law is None else [verdict.law]
    rest = law + [claim for claim in verdict.last if claim is not verdict.law]
    unnamed = {"probability": None, "step": len(verdict.causes) + 1}
    return rows + [_candidate(verdict, claim) | unnamed for claim in rest]


def _candidate(verdict: Verdict, claim: Claim) -> dict[str, Any]:
    """One row of `candidates`."""
    rms = [fit.rms() for fit in claim.fits.values()]
    cause, variant = claim.hypothesis.cause, claim.hypothesis.variant
    one = cause and len(extend.pieces(verdict.judge, claim)) == 1
    values = extend.parameters(verdict.judge, claim) if one else {}
    return {
        "cause": cause or variant,
        "variant": variant if cause else "not in the catalogue",
        "where": _named_places(verdict, claim),
        "parameters": {
            name: {"value": value, "unit": _units(claim).get(name, "1")}
            for name, value in values.items()
        },
        "log_evidence": round(claim.gain, 1),
        "rms": rms[0] if rms else None,
    }


def _units(claim: Claim) -> dict[str, str]:
    """Units of a named claim's parameters."""
    entry = CATALOGUE[claim.hypothesis.cause]
    return {p.name: p.unit for p in entry.parameters} | UNITS


def _named_places(verdict: Verdict, claim: Claim) -> list[str]:
    """Every joint of a claim by name; imu, ground or a foot."""
    if claim.stance is not None:
        return [claim.stance.where]
    return [verdict.judge.joints[k].name for k in claim.where]


def joint_rows(verdict: Verdict) -> list[dict[str, Any]]:
    """Misfit of every joint: noise, tolerances alone, named causes.

    All three are of a joint that is drawn to its measured motion where `drawn` says so.
    """
    rows = []
    judge = verdict.judge
    for joint, healthy, known in zip(
        judge.joints, judge.case.healthy, judge.known, strict=True
    ):
        nominal = judge.case.joints[joint.index].residual(
            [numbers(joint, None, np.zeros(COUNT))], False
        )
        left = max(0.0, healthy.rms() ** 2 - (LEFT * joint.noise) ** 2)
        rows.append(
            {
                "name": joint.name,
                "drawn": "pull" in joint.nominal,
                "noise": joint.noise,
                "nominal_rms": float(np.sqrt(np.mean(np.square(nominal)))),
                "tolerance_rms": healthy.rms(),
                "extended_rms": known.rms(),
                "beyond_tolerance": left / max(healthy.rms() ** 2, 1e-30),
            }
        )
    return rows


def calibration_rows(verdict: Verdict) -> list[dict[str, Any]]:
    """Nominal numbers and what the logs say of them, within the tolerances."""
    rows = []
    for joint, fit in zip(verdict.judge.joints, verdict.judge.known, strict=True):
        drive = numbers(joint, None, fit.x[:COUNT])
        gain = "N*m/rad" if joint.servoed else "N*m per command"
        for name, unit in {"kp": gain, **NUMBERS}.items():
            if name == "limit" and not joint.limited:
                continue  # the model gives none
            share, own = getattr(joint.allowed, name), joint.nominal[name]
            fitted = own if extend.set_by_cause(joint, fit, name) else drive[name]
            rows.append(
                {"parameter": name, "where": joint.name, "unit": unit,
                 "nominal": own, "fitted": fitted,
                 "tolerance": share * own}
            )  # fmt: skip
        for name in ZEROS if joint.servoed else ("zero_out",):
            rows.append(
                {"parameter": ZEROS[name], "where": joint.name, "unit": "rad",
                 "nominal": joint.nominal.get(name, 0.0), "fitted": drive[name],
                 "tolerance": joint.allowed.zero}
            )  # fmt: skip
        rows += [
            {"parameter": "transport of commands", "where": joint.name, "unit": "s",
             "nominal": joint.nominal["delay"], "fitted": drive["delay"],
             "tolerance": joint.allowed.late},
        ]  # fmt: skip
    return rows


def left_aside(
    verdict: Verdict, logs: list[str], whole: list[JointRun]
) -> list[dict[str, Any]]:
    """Pieces of the logs that do not count at a joint, for nothing explains them."""
    case = verdict.judge.case
    return [
        {"joint": case.joints[k].name, "log": logs[n],
         "trajectory": source(case.runs[n], whole),
         "from": float(case.runs[n].time[0]), "to": float(case.runs[n].time[-1])}
        for k, runs in sorted(case.aside.items())
        for n in sorted(runs)
    ]  # fmt: skip


def unexplained(
    verdict: Verdict, beside: list[dict[str, np.ndarray]]
) -> dict[str, Any]:
    """What no cause explains: how much, where, and what it may be."""
    judge = verdict.judge
    names = [judge.joints[k].name for k in verdict.unexplained]
    before = sum(fit.rms() ** 2 for fit in judge.case.healthy)
    floor = sum((LEFT * joint.noise) ** 2 for joint in judge.joints)
    left = sum(fit.rms() ** 2 for fit in judge.known)
    share = max(0.0, left - floor) / max(before, floor)
    found: dict[str, Any] = {"depends_on": [], "term": None}
    if names:
        index = max(
            verdict.unexplained,
            key=lambda k: judge.known[k].rms() / judge.joints[k].noise,
        )
        found = explore(judge.case, judge.joints[index], judge.known[index], beside)
    if verdict.law is not None:
        values = extend.parameters(verdict.judge, verdict.law)
        told = ", ".join(f"{name} {value:.3g}" for name, value in values.items())
        found["law"] = f"{verdict.law.hypothesis.variant} ({told})"
    return {"significant": bool(names), "share": float(share), "where": names, **found}
