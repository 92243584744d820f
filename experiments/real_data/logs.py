"""The part of a log that the robot moves freely in."""

from __future__ import annotations

from gatjax.data.recording import Recording


def until(log: Recording, end: float) -> Recording:
    """The rows of a log before a time, s."""
    early = log.time < end
    columns = {name: values[early] for name, values in log.columns.items()}
    return log._replace(
        time=log.time[early], trajectory=log.trajectory[early], columns=columns
    )
