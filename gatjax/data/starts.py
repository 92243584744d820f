"""How trajectories start: simulations start at rest, at the first command."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from gatjax.data.finding import Finding, angle, cell
from gatjax.data.recording import Recording
from gatjax.data.trajectories import JointRun, scatter

SPAN, ROWS = 0.02, 2  # s and intervals, at least, that a speed is taken over
MOMENT = 0.06  # s within which a joint that starts at rest gets much faster
CRAWL = 0.1  # rad/s, what is slower starts at rest
STEADY = 0.65  # of the speed a moment later: what starts at rest has less
SURE = 5.0  # deviations that a speed at the start is above noise
CATCH = 1.0  # s until a simulation has made up for a wrong start; half a run at most
AWAY = 0.2  # rad between first command and first position
LATE = 0.02  # rad, of which a joint makes up
SOON = 0.3  # s within which it does
MADE_UP = 0.3  # share of it, ahead of how far commands went


def unsettled(run: JointRun) -> np.ndarray:
    """Which joints [J] had not yet moved to the first command when a run began.

    At rest in balance, a joint goes after its command; these move before it does, as
    where a log's first row holds the first new target.
    """
    count = int(np.searchsorted(run.time - run.time[0], SOON)) + 1
    short = run.command[0] - run.angle[0]
    moved, told = (
        np.sign(short) * (each[:count] - each[0]) for each in (run.angle, run.command)
    )
    ahead = (moved - np.maximum.accumulate(told, axis=0)).max(0)
    noise = SURE * np.sqrt(2.0) * scatter(run.angle)
    return (np.abs(short) > LATE) & (ahead > MADE_UP * np.abs(short) + noise)


def underway(run: JointRun) -> np.ndarray:
    """Speed [J] rad/s of the joints that moved when a run began, 0 for the others.

    Those that start at rest are much faster a moment later, and so are not taken for
    moving when commands start with a step.
    """
    since = run.time - run.time[0]
    rows = max(ROWS, int(np.searchsorted(since, SPAN - 1e-6)))
    if len(since) <= rows:
        return np.zeros(run.angle.shape[1])
    some = slice(0, rows + max(rows, int(np.searchsorted(since, MOMENT - 1e-6))) + 1)
    lasts = (since[rows:] - since[:-rows])[some, None]
    speed = (run.angle[rows:] - run.angle[:-rows])[some] / lasts
    spread = np.sqrt(2.0) * scatter(run.angle) / lasts[0]
    later = STEADY * np.abs(speed).max(axis=0)
    least = np.maximum(np.maximum(CRAWL, later), SURE * spread)
    return np.where(np.abs(speed[0]) > least, speed[0], 0.0)


def early(run: JointRun, seconds: float = CATCH) -> np.ndarray:
    """Rows [T] bool before a simulation has made up for a wrong start."""
    since = run.time - run.time[0]
    return since <= min(seconds, 0.5 * since[-1])


def check_start(
    recording: Recording, runs: Sequence[JointRun], joints: Sequence[str]
) -> list[Finding]:
    """Trajectories that do not start at rest at the first command."""
    found = []
    for run in runs:
        rows = np.flatnonzero(recording.trajectory == run.trajectory)
        speed, away = underway(run), np.abs(run.angle[0] - run.command[0])
        late = np.where(unsettled(run), away, 0.0)
        fast, far = int(np.argmax(np.abs(speed))), int(np.argmax(away - late))
        if speed[fast] != 0.0:
            text = (
                f"{cell(recording, rows[0], f'position.{joints[fast]}')}: moves at "
                f"{speed[fast]:.2g} rad/s when the trajectory begins; simulations "
                f"start at rest, so its first second does not count"
            )
            found.append(Finding("warning", "start", text, {joints[fast]: speed[fast]}))
        if late.any():
            last = int(np.argmax(late))
            text = (
                f"{cell(recording, rows[0], f'position.{joints[last]}')}: starts "
                f"{angle(float(late[last]))} from its first command and moves there at "
                f"once; it had not settled, so its first second does not count"
            )
            found.append(Finding("warning", "start", text, {joints[last]: late[last]}))
        if away[far] - late[far] > AWAY:
            text = (
                f"{cell(recording, rows[0], f'position.{joints[far]}')}: starts "
                f"{angle(float(away[far]))} from its command; an offset, a heavy load, "
                f"or a start before the joint had settled"
            )
            values = {joints[far]: float(away[far])}
            found.append(Finding("warning", "start", text, values))
    return found
