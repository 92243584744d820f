"""Checks of how a recording was sampled: rate, gaps, encoder step, noise, units."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from gatjax.data.finding import DEGREES, Finding, Ranges, angle, cell
from gatjax.data.mapping import UNITS, degrees_map
from gatjax.data.metadata import ANGLE
from gatjax.data.recording import Recording
from gatjax.data.trajectories import GAP, RATE_TOLERANCE, JointRun, soon_after

SLOWEST, FASTEST = 1.0, 1e-4  # s, no log of a servo has periods outside of these
SLOW = 0.05  # s, the longest period that delays and reversals can be seen with
COARSE = 0.01  # rad, half a degree: coarser steps hide most effects
LONGEST = 900.0  # s of a trajectory
LASTING, ROWS = 1.0, 30  # s and rows of the shortest trajectory
LEAKS = 0.7  # share that sixth differences find where motion leaks into second ones
CALM = 16  # samples that noise is measured over at a time
LEAST_USUAL = 2e-4  # s, a usual period is between this and SLOW
LONG = 0.1  # s of a gap in which commands may have been sent that matter
WIDEST = 1.0  # s of a gap
MOST_LOST = 0.5  # share of the rows that may follow gaps
RECOVERY = 0.5  # s after a long gap until readings tell of the logged commands again
SAME = 1e-6  # rad by which commands may differ that are the same
OUTSIDE = 0.2  # of the joint's range: further outside it is a unit, not a slip


def lasting(recording: Recording) -> tuple[Recording, list[Finding]]:
    """Leave out trajectories too short to tell anything of, with a warning.

    Raises:
        ValueError: none is long enough.
    """
    names, index = np.unique(recording.trajectory, return_inverse=True)
    ends = [recording.time[recording.trajectory == name][[0, -1]] for name in names]
    lasts = np.ptp(ends, axis=1) >= LASTING
    good = lasts & (np.bincount(index) >= ROWS)
    if good.all():
        return recording, []
    need = f"lasts {LASTING:g} s and has {ROWS} rows"
    if not good.any():
        raise ValueError(f"{recording.name}: no trajectory {need}; log longer ones")
    kept = good[index]
    some = recording._replace(
        time=recording.time[kept], trajectory=recording.trajectory[kept],
        columns={name: column[kept] for name, column in recording.columns.items()},
    )  # fmt: skip
    text = f"{recording.name}: {np.sum(~good)} of {len(good)} trajectories left out, "
    text += f"none of which {need}; rows below are counted without them"
    values = {"left_out": float(np.sum(~good))}
    return some, [Finding("warning", "length", text, values)]


def check_rate(recording: Recording, runs: Sequence[JointRun]) -> list[Finding]:
    """Sampling period, its jitter, and whether it can be in seconds at all."""
    steps = np.concatenate([np.diff(run.time) for run in runs])
    if steps.size == 0:
        text = "one row in every trajectory; give the rows of a run the same number"
        return [Finding("refuse", "rate", f"{recording.name}: {text}", {})]
    period = float(np.median(steps))
    jitter = float(np.median(np.abs(steps - period)) * 1.4826)  # normal: one sigma
    values = {"period": period, "jitter": jitter}
    head = f"{recording.name}: column 'time': a row every"
    if not FASTEST <= period <= SLOWEST:
        unit = _likely_unit(period)
        advice = "write it in seconds"
        if unit is not None:
            advice = f"looks like {unit}; use a map with time: {{unit: {unit}}}"
        text = f"{head} {period:.3g} s; no log of a servo is like that: {advice}"
        return [Finding("refuse", "rate", text, values)]
    longest = max(runs, key=lambda run: run.time[-1] - run.time[0])
    if longest.time[-1] - longest.time[0] > LONGEST:
        text = (
            f"{recording.name}: trajectory {longest.trajectory} lasts "
            f"{longest.time[-1] - longest.time[0]:.0f} s; a diagnosis takes "
            f"{LONGEST:g} s at most and learns little from more, cut it at rests"
        )
        return [Finding("refuse", "rate", text, values)]
    text = f"{head} {1e3 * period:.4g} ms ({1.0 / period:.4g} Hz), jitter "
    text += f"{1e3 * jitter:.2g} ms"
    stated = recording.metadata.get("rate_hz")
    if period > SLOW:
        text += "; too slow to see delays and reversals, log at 50 Hz or faster"
        return [Finding("warning", "rate", text, values)]
    if stated and abs(period * float(stated) - 1.0) > RATE_TOLERANCE:
        text += f"; the metadata says {float(stated):.4g} Hz, mend one of the two"
        return [Finding("warning", "rate", text, values)]
    return [Finding("info", "rate", text, values)]


def _likely_unit(period: float) -> str | None:
    """The unit of time that makes a usual period of a number, if there is one."""
    return next(
        (
            unit
            for unit, factor in UNITS["time"].items()
            if LEAST_USUAL <= factor * period <= SLOW
        ),
        None,
    )


def check_gaps(recording: Recording, runs: Sequence[JointRun]) -> list[Finding]:
    """Steps of time of more than one and a half periods."""
    steps = np.concatenate([np.diff(run.time) for run in runs])
    if steps.size == 0:
        return []
    period = float(np.median(steps))
    wide = [
        (run, row, float(step))
        for run in runs
        for row, step in enumerate(np.diff(run.time))
        if step > (1.0 + GAP) * period
    ]
    if not wide:
        return []
    run, row, step = wide[0]
    rows = np.flatnonzero(recording.trajectory == run.trajectory)
    longest = max(each[2] for each in wide)
    lost = [after_gaps(run.time, run.command) for run in runs]
    share = float(np.concatenate(lost).mean())
    text = (
        f"{cell(recording, rows[row + 1], 'time')}: {step:.3g} s after the row "
        f"before; such gaps: {len(wide)}, the longest of {longest / period:.1f} periods"
    )
    values = {"gaps": float(len(wide)), "longest": longest, "lost": share}
    if longest > WIDEST or share > MOST_LOST:
        text += (
            f"; commands sent meanwhile are unknown: log without gaps, or give the "
            f"rows after each rest a trajectory number of their own ({share:.0%} of "
            f"the rows come within {RECOVERY:g} s after a gap of {LONG:g} s or more, "
            f"{WIDEST:g} s is the longest that is taken)"
        )
        return [Finding("refuse", "gaps", text, values)]
    if share > 0.0:
        text += (
            f"; commands sent meanwhile are unknown, readings until {RECOVERY:g} s "
            f"after the long ones do not count ({share:.0%} of the rows)"
        )
    return [Finding("warning", "gaps", text, values)]


def after_gaps(time: np.ndarray, command: np.ndarray) -> np.ndarray:
    """Rows [N] bool soon after a gap that was long enough for unseen commands.

    A gap in which the command [N, J] rad stayed as it was is none.
    """
    steps = np.diff(time, prepend=time[0])
    long = steps >= max(LONG, (1.0 + GAP) * float(np.median(steps[1:])))
    changed = np.abs(np.diff(command, axis=0, prepend=command[:1])).max(1) > SAME
    return soon_after(time, long & changed, RECOVERY)


def check_resolution(
    recording: Recording, steps: Mapping[str, float], noise: Mapping[str, float]
) -> list[Finding]:
    """Encoder step and noise, the worst joint in words."""
    found = []
    for check, size in (("encoder step", steps), ("noise", noise)):
        joint = max(size, key=lambda each: size[each])
        text = f"{recording.name}: column 'position.{joint}' has the largest {check}"
        text += f": {angle(size[joint])}"
        coarse = size[joint] > COARSE
        if coarse:
            text += "; what it hides cannot be named, smaller effects stay unseen"
        level = "warning" if coarse else "info"
        found.append(Finding(level, check, text, dict(size)))
    return found


def check_units(recording: Recording, ranges: Ranges) -> list[Finding]:
    """Angles below a full turn that only make sense as degrees, or with an offset.

    What lies beyond the joint's limits is in degrees if it moves further than they
    allow, too.
    """
    follows = recording.command_unit == ANGLE
    wide: dict[str, int] = {}  # columns and their first such row
    found = []
    for column, values in recording.columns.items():
        family, _, joint = column.partition(".")
        low, high = ranges.get(joint, (-np.inf, np.inf))
        angles = ("command", "position") if follows else ("position",)
        if family not in angles or not np.isfinite([low, high]).all():
            continue
        slack = OUTSIDE * (high - low)
        out = np.flatnonzero((values > high + slack) | (values < low - slack))
        turned = values / DEGREES
        fits = bool(np.all((turned > low - slack) & (turned < high + slack)))
        if out.size <= OUTSIDE * values.size:
            continue
        if fits and np.ptp(values) > high - low + slack:
            wide[column] = int(out[0])
        elif family == "position":
            text = (
                f"{cell(recording, out[0], column)}: {values[out[0]]:.3g} rad is far "
                f"beyond the joint limits {low:.3g} and {high:.3g} rad; give it its "
                f"sign or offset in a --map file, or mend the limits of the model"
            )
            found.append(
                Finding("refuse", "offset", text, {joint: float(values[out[0]])})
            )
    advice = repr(degrees_map(list(wide), recording.columns))
    for column, row in wide.items():
        joint, values = column.partition(".")[2], recording.columns[column]
        low, high = ranges[joint]
        text = (
            f"{cell(recording, row, column)}: {values[row]:.3g} rad with joint limits "
            f"{low:.3g} and {high:.3g} rad looks like degrees: say so in a --map file: "
            f"{advice}; else mend the limits of the model"
        )
        largest = float(np.max(np.abs(values)))
        found.append(Finding("refuse", "units", text, {joint: largest}))
    return found


def encoder_step(values: np.ndarray) -> float:
    """Step, rad, that all readings [N] are apart by whole numbers of; 0 if none is."""
    apart = np.diff(np.unique(values))
    apart = apart[apart > 1e-9]
    if apart.size < 2:
        return 0.0
    step = float(np.min(apart))
    whole = apart / step
    fits = np.abs(whole - np.round(whole)) < 0.02 * np.maximum(whole, 1.0)
    return step if fits.mean() > 0.95 and apart.size < 0.9 * values.size else 0.0


def noise_of(runs: Sequence[np.ndarray]) -> float:
    """Noise, rad, of readings [N] of runs, from the calmer quarter of differences.

    White noise of size s has second differences of size s sqrt(6), and sixth ones of
    s sqrt(924). Motion adds to both, so calm parts count; where it leaks into second
    ones, at few rows a second, sixth ones tell less of it.
    """
    second, sixth = _level(runs, 2, np.sqrt(6.0)), _level(runs, 6, np.sqrt(924.0))
    found = sixth if sixth < LEAKS * second else second
    return found if np.isfinite(found) else 0.0


def _level(runs: Sequence[np.ndarray], order: int, spread: float) -> float:
    """What differences of an order tell; infinite where there are none."""
    bends = [np.diff(values, order) / spread for values in runs]
    parts = [b[: len(b) // CALM * CALM].reshape(-1, CALM) for b in bends]
    sizes = np.sqrt(np.mean(np.square(np.concatenate(parts)), axis=1))
    if not len(sizes):
        every = np.concatenate(bends)
        return float(np.std(every)) if every.size else np.inf
    return float(np.quantile(sizes, 0.25))
