"""The pictures of one joint as inline svg; angles in degrees."""

from __future__ import annotations

import itertools
from collections.abc import Callable
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.ticker import FuncFormatter, NullFormatter

from gatjax.report.diagnosis.read import Signals, Trace
from gatjax.report.diagnosis.response import response
from gatjax.report.diagnosis.signals import binned, slow_ways, speed, thinned
from gatjax.report.ink import COLOURS, FAINT, INK, draw

NOMINAL, EXTENDED = COLOURS["none"], COLOURS["gat"]
Model = tuple[str, np.ndarray]  # colour, angle [N] rad


def models(trace: Trace) -> list[Model]:
    """The simulations of a joint, in their colours."""
    every = ((NOMINAL, trace.nominal), (EXTENDED, trace.extended))
    return [(colour, angle) for colour, angle in every if angle is not None]


def stroke(colour: str) -> dict[str, Any]:
    """Width of a line: the later it is drawn, the thinner, so that none hides another.

    What was measured lies broad and pale below the models.
    """
    if colour == INK:
        return {"lw": 4.5, "alpha": 0.4}
    return {"lw": 2.4 if colour == NOMINAL else 1.2}


def overlay(signals: Signals, trace: Trace, rows: np.ndarray) -> str:
    """Command, measured and simulated angle over some rows [M] of one run."""
    begin = signals.time[signals.run == signals.run[rows[0]]].min()
    time = signals.time[rows] - begin

    def paint(axes: Axes) -> None:
        if trace.command is not None:
            sent = thinned(time, np.rad2deg(trace.command[rows]))
            axes.step(*sent, color=FAINT, lw=1, where="post", linestyle=(0, (2, 2)))
        for colour, angle in ((INK, trace.measured), *models(trace)):
            line = thinned(time, np.rad2deg(angle[rows]))
            axes.plot(*line, color=colour, **stroke(colour))
        axes.set_xlabel("time since the start of the log, s")
        axes.set_ylabel("angle, degrees")

    return draw(paint)


def residual_over_time(signals: Signals, trace: Trace) -> str:
    """Measured minus simulated angle, the runs one after the other."""

    def paint(axes: Axes) -> None:
        start = 0.0
        for run in np.unique(signals.run):
            rows = np.flatnonzero(signals.run == run)
            time = signals.time[rows] - signals.time[rows[0]] + start
            for colour, angle in models(trace):
                rest = np.rad2deg(trace.measured[rows] - angle[rows])
                axes.plot(*thinned(time, rest), color=colour, **stroke(colour))
            if signals.held[rows[0]]:
                axes.axvspan(time[0], time[-1], color=FAINT, alpha=0.12, linewidth=0)
            start = float(time[-1]) + 0.5
        axes.axhline(0.0, color=FAINT, linewidth=0.8)
        axes.set_xlabel("time, logs one after the other, s")
        axes.set_ylabel("measured - simulated, degrees")

    return draw(paint)


def residual_against(trace: Trace, variable: np.ndarray, label: str) -> str | None:
    """Binned residual against a variable [N]; None if that stands still."""
    lines = [
        (colour, binned(variable, np.rad2deg(trace.measured - angle)))
        for colour, angle in models(trace)
    ]
    if any(bins is None for _, bins in lines):
        return None

    def paint(axes: Axes) -> None:
        for colour, bins in lines:
            if bins is not None:
                ends = (bins.mean - bins.spread, bins.mean + bins.spread)
                axes.fill_between(bins.centre, *ends, color=colour, alpha=0.15, lw=0)
                line = stroke(colour)
                axes.plot(bins.centre, bins.mean, "o-", color=colour, ms=3.5, **line)
        axes.axhline(0.0, color=FAINT, linewidth=0.8)
        axes.set_xlabel(label)
        axes.set_ylabel("measured - simulated, degrees")

    return draw(paint)


def residual_pictures(signals: Signals, trace: Trace) -> dict[str, str]:
    """Residual against position, velocity and load, as far as they change."""
    rate = np.rad2deg(speed(signals, trace.nominal))
    variables = {
        "position": (
            np.rad2deg(trace.nominal),
            "position of the nominal model, degrees",
        ),
        "velocity": (rate, "velocity of the nominal model, degrees/s"),
    }
    if trace.load is not None:
        variables["load"] = (trace.load, "load torque of the nominal model, N m")
    made = {
        f"Residual against {name}": residual_against(trace, values, label)
        for name, (values, label) in variables.items()
    }
    return {title: svg for title, svg in made.items() if svg is not None}


def hysteresis(signals: Signals, trace: Trace) -> str | None:
    """Command minus angle against command in slow motion, rising and falling."""
    command = trace.command
    if command is None:
        return None
    ways = slow_ways(signals, command)
    loops = []
    for colour, angle in ((INK, trace.measured), *models(trace)):
        behind = np.rad2deg(command - angle)
        for rows, dash in zip(ways, ("-", (0, (3, 2))), strict=True):
            loops.append((colour, dash, binned(command[rows], behind[rows])))
    if any(bins is None for _, _, bins in loops):
        return None

    def paint(axes: Axes) -> None:
        for colour, dash, bins in loops:
            if bins is not None:
                place = np.rad2deg(bins.centre)
                axes.plot(
                    place, bins.mean, color=colour, linestyle=dash, **stroke(colour)
                )
        axes.set_xlabel("command, degrees")
        axes.set_ylabel("command - angle, degrees")

    return draw(paint)


def response_pictures(signals: Signals, trace: Trace) -> dict[str, str]:
    """Gain and delay over frequency, measured and simulated."""
    command = trace.command
    if command is None:
        return {}
    lines = [
        (colour, response(signals, command, angle))
        for colour, angle in ((INK, trace.measured), *models(trace))
    ]
    if any(len(each.frequency) < 4 for _, each in lines):
        return {}

    def painter(unit: str, pick: Callable) -> Callable[[Axes], None]:
        def paint(axes: Axes) -> None:
            for colour, each in lines:
                axes.plot(each.frequency, pick(each), color=colour, **stroke(colour))
            ends = np.array([each.frequency[[0, -1]] for _, each in lines])
            _hertz(axes, float(ends.min()), float(ends.max()))
            axes.set_ylabel(unit)

        return paint

    return {
        "Response to the command: gain": draw(
            painter("gain, rad per rad", lambda each: each.gain)
        ),
        "Response to the command: delay": draw(
            painter("delay, ms", lambda each: 1e3 * each.delay)
        ),
    }


def _hertz(axes: Axes, low: float, high: float) -> None:
    """A logarithmic axis of frequency with plain numbers."""
    axes.set_xscale("log")
    axes.set_xlim(0.97 * low, 1.03 * high)
    ticks = [
        digit * ten
        for ten, digit in itertools.product((0.1, 1.0, 10.0), (1, 1.5, 2, 3, 5, 7))
        if low <= digit * ten <= high
    ]
    axes.set_xticks(ticks)
    axes.xaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    axes.xaxis.set_minor_formatter(NullFormatter())
    axes.set_xlabel("frequency, Hz")
