"""Progress of long work on a terminal, or as plain lines in a log."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager

from rich.console import Console
from rich.progress import (
    BarColumn,
    Progress,
    TaskID,
    TaskProgressColumn,
    TextColumn,
    TimeElapsedColumn,
    TimeRemainingColumn,
)

from gatjax.cli.interrupts import check
from gatjax.hardware.links import is_hardware
from gatjax.runs import Progress as Teller

QUIET = 20.0  # s until a log hears of a stage again that goes on


@contextmanager
def shown(total: float) -> Iterator[Teller]:
    """Show progress over `total` work units, with the time left."""
    if sys.stderr.isatty():
        columns = (
            TextColumn("{task.description:<34}"), BarColumn(), TaskProgressColumn(),
            TimeElapsedColumn(), TextColumn("left"), TimeRemainingColumn(),
        )  # fmt: skip
        with Progress(*columns, console=Console(stderr=True)) as bar:
            task = bar.add_task("", total=total)
            yield _heeding(
                stage=lambda text: bar.update(task, description=text),
                work=lambda units: bar.advance(task, units),
                past=lambda units: _skip(bar, task, units),
            )
        return
    with lines(total) as teller:
        yield teller


def _skip(bar: Progress, task: TaskID, units: float) -> None:
    """Begin where an earlier session ended: that took no time of this one."""
    if units:
        known = bar.tasks[task]
        begun, done = known.start_time, known.completed + units
        bar.reset(task, completed=done)  # pyright: ignore[reportArgumentType]
        known.start_time = begun


def _heeding(
    stage: Callable[[str], None],
    work: Callable[[float], None],
    past: Callable[[float], None],
) -> Teller:
    """Stop at the next stage or piece of work if a Ctrl-C got lost."""

    def checked_stage(text: str) -> None:
        check()
        stage(text)

    def checked_work(units: float) -> None:
        check()
        work(units)

    return Teller(checked_stage, checked_work, past)


def _span(seconds: float) -> str:
    """A time in the unit that reads best."""
    return f"{seconds:.0f} s" if seconds < 60.0 else f"{seconds / 60.0:.1f} min"


def shown_beside(robot: str, total: float) -> AbstractContextManager[Teller]:
    """Show progress of work with a robot; a bar would run over what a person is asked.

    Args:
        robot: its name, as `--robot` has it.
        total: work units.
    """
    return lines(total) if is_hardware(robot) else shown(total)


@contextmanager
def lines(total: float) -> Iterator[Teller]:
    """Show progress in plain lines."""
    begun, done, before, named = time.monotonic(), 0.0, 0.0, ""
    said = begun

    def stage(text: str) -> None:
        nonlocal named, said
        named, said = text, time.monotonic()
        passed = said - begun
        own = done - before
        left = passed * (total - done) / own if own > 0.0 else 0.0
        ahead = f", about {_span(left)} left" if left > 0.0 else ""
        print(f"[{passed:5.0f} s, {done / total:4.0%}{ahead}] {text}", file=sys.stderr)

    def work(units: float) -> None:
        nonlocal done
        done = min(total, done + units)
        if time.monotonic() - said > QUIET:
            stage(named)

    def past(units: float) -> None:
        nonlocal done, before
        done, before = min(total, done + units), before + units

    yield _heeding(stage, work, past)
