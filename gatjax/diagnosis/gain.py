"""What an extended simulation gains on held-out logs, at all horizons."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from gatjax.data.trajectories import JointRun
from gatjax.diagnosis import ahead, learned, measure
from gatjax.diagnosis.case import Case
from gatjax.diagnosis.measure import Errors, Replayed
from gatjax.grounding.network import Network
from gatjax.sim.limbs import floats
from gatjax.sim.world import World


class Predicted(NamedTuple):
    """Open-loop predictions of whole runs."""

    fit: list[Replayed]
    unseen: list[Replayed]

    def angles(self) -> tuple[list[np.ndarray], list[np.ndarray]]:
        """Of the fit and of the held-out runs, [N, J] rad."""
        fit, unseen = ([each.angle for each in runs] for runs in self)
        return fit, unseen


def gained(
    worlds: dict[str, World], pairs: dict[str, Predicted], alone: Predicted | None,
    logs: list[JointRun], unseen: list[JointRun], case: Case, seed: int,
) -> dict[str, Any] | None:  # fmt: skip
    """Errors on the held-out runs, before and after, at all horizons.

    Args:
        worlds: nominal and extended.
        pairs: their predictions of whole logs.
        alone: predictions of the extended world without its calibration, if that is
            another one.
        logs: that were explained; the learned model is trained on them.
        unseen: held-out.
        case: of the diagnosis, for the noise.
        seed: of everything that is drawn.

    Returns:
        `gain` of diagnosis.json; None if a standing robot fell at once.
    """
    forward, names = learned.learn(logs, seed), [joint.name for joint in case.joints]
    series = {
        "before": pairs["nominal"].angles()[1],
        "after": pairs["extended"].angles()[1],
        "learned": learned.whole_log(forward, unseen),
    }
    whole = measure.log_errors(unseen, series)
    rows = sum(len(run.time) for run in unseen)
    compared = len(whole["before"].block) / rows
    if compared == 0.0:
        return None  # a robot fell at once
    horizons = _rows(None, whole, names)
    if not floats(worlds["nominal"].model):
        horizons += _ahead(worlds, unseen, forward, names)
    first = horizons[0]
    learnable = first["before"] - first["learned"]
    without = None
    if alone is not None:
        series["alone"] = alone.angles()[1]
        error = measure.log_errors(unseen, series)["alone"]
        if len(error.block) == len(whole["after"].block):  # it stands as long
            without = float(np.sqrt(error.squared.mean()))
    return {
        "metric": "position rmse", "unit": "rad", **{
            key: first[key] for key in ("before", "after", "low", "high")
        },
        "without_calibration": without,
        "noise_floor": _reading(case),
        "learned_ceiling": first["learned"],
        "learned_share": (first["before"] - first["after"]) / learnable
        if learnable > 0.0 else None,
        "compared_share": compared,
        "promoted": bool(first["low"] > 0.0),
        "horizons": horizons,
    }  # fmt: skip


def _reading(case: Case) -> float:
    """Noise of the readings of all joints, rad; how close is close enough left out."""
    power = [
        joint.noise**2 - joint.allowed.close(joint.name) ** 2 for joint in case.joints
    ]
    return float(np.sqrt(np.mean(power)))


def half_second(
    nominal: World, extended: World, unseen: list[JointRun]
) -> tuple[Errors, Errors] | None:
    """Errors of two worlds half a second ahead of measured states, if runs have any."""
    period = nominal.task.control_period
    cut = ahead.windows(unseen, period)
    if cut is None:
        return None
    first, second = (
        ahead.window_errors(
            cut, ahead.windowed(world, cut, period), ahead.HORIZONS[0], period
        )
        for world in (nominal, extended)
    )
    return first, second


def _ahead(
    worlds: dict[str, World], unseen: list[JointRun], forward: Network,
    joints: list[str],
) -> list[dict[str, Any]]:  # fmt: skip
    """Rows of the short horizons, which start from measured states."""
    period = worlds["nominal"].task.control_period
    cut = ahead.windows(unseen, period)
    if cut is None:
        return []
    played = {
        "before": ahead.windowed(worlds["nominal"], cut, period),
        "after": ahead.windowed(worlds["extended"], cut, period),
        "learned": learned.windows(forward, cut, period),
    }
    rows = []
    for horizon in ahead.HORIZONS:
        errors = {
            name: ahead.window_errors(cut, angles, horizon, period)
            for name, angles in played.items()
        }
        rows += _rows(horizon or period, errors, joints)
    return rows


def _rows(
    horizon: float | None, errors: dict[str, Errors], joints: list[str]
) -> list[dict[str, Any]]:
    """Rows of one horizon: all joints together, then each."""
    rows = []
    for index, name in [(None, "all"), *enumerate(joints)]:
        low, high = measure.interval(errors["before"], errors["after"], index)
        pick = slice(None) if index is None else index
        values = {
            key: float(np.sqrt(error.squared[:, pick].mean()))
            for key, error in errors.items()
        }
        rows.append(
            {"horizon_s": horizon, "joint": name, **values, "low": low, "high": high}
        )
    return rows
