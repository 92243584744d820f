"""The pictures that compare joints or horizons, as inline svg; angles in degrees."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes

from gatjax.report.diagnosis.figures import EXTENDED, NOMINAL
from gatjax.report.diagnosis.read import Horizon, Joint, number_in
from gatjax.report.ink import COLOURS, INK, draw

CEILING = COLOURS["guided"]


def location_picture(joints: Sequence[Joint]) -> str:
    """Residual of every joint: nominal, after tolerances, extended, noise."""

    def paint(axes: Axes) -> None:
        for row, joint in enumerate(joints):
            nominal, rest, after, noise = (
                math.degrees(value)
                for value in (
                    joint.nominal,
                    joint.tolerance,
                    joint.extended,
                    joint.noise,
                )
            )
            axes.barh(row, nominal, height=0.62, color=NOMINAL, alpha=0.28, lw=0)
            axes.barh(row, rest, height=0.62, color=NOMINAL, lw=0)
            axes.plot(after, row, "o", color=EXTENDED, markersize=6)
            axes.plot(noise, row, "|", color=INK, markersize=12, markeredgewidth=2)
        _named_rows(axes, [joint.name for joint in joints])
        axes.set_xlabel("residual on the fit logs (rms), degrees")

    return draw(paint, height=0.9 + 0.28 * len(joints))


def signal_picture(rows: Sequence[dict[str, Any]]) -> str:
    """Residuals of what is logged besides angles, in units of their noise."""

    def paint(axes: Axes) -> None:
        for place, row in enumerate(rows):
            nominal, rest, after = (
                number_in(row, f"{name}_rms") / (number_in(row, "noise") or math.nan)
                for name in ("nominal", "tolerance", "extended")
            )
            axes.barh(place, nominal, height=0.62, color=NOMINAL, alpha=0.28, lw=0)
            axes.barh(place, rest, height=0.62, color=NOMINAL, lw=0)
            axes.plot(after, place, "o", color=EXTENDED, markersize=6)
        axes.axvline(1.0, color=INK, linewidth=1.5)
        _named_rows(axes, [str(row.get("name", "")) for row in rows])
        axes.set_xlabel("residual on the fit logs (rms), times the noise")

    return draw(paint, height=0.9 + 0.28 * len(rows))


def error_picture(rows: Sequence[Horizon], floor: float) -> str:
    """Held-out error of all joints by horizon, before and after.

    A learned model that is worse than the nominal one is left out: it measures nothing.
    """

    def paint(axes: Axes) -> None:
        dashes = {"linestyle": (0, (4, 3)), "linewidth": 1.4}
        if math.isfinite(floor):
            axes.axhline(math.degrees(floor), color=INK, **dashes)
        for place, row in enumerate(rows):
            if row.learnable:
                height = math.degrees(row.learned)
                ends = place - 0.4, place + 0.4
                axes.plot(ends, [height] * 2, color=CEILING, **dashes)
        places = np.arange(len(rows))
        for shift, colour, errors in (
            (-0.17, NOMINAL, [row.before for row in rows]),
            (0.17, EXTENDED, [row.after for row in rows]),
        ):
            axes.bar(places + shift, np.rad2deg(errors), 0.3, color=colour, lw=0)
        _horizons(axes, rows)
        axes.set_ylabel("held-out error (rms), degrees")
        axes.set_ylim(bottom=0.0)

    return draw(paint)


def gain_picture(rows: Sequence[Horizon]) -> str:
    """Held-out gain of all joints by horizon with its interval, per cent."""

    def paint(axes: Axes) -> None:
        for place, row in enumerate(rows):
            gain = 100.0 * gain_of(row)
            if math.isfinite(row.low) and math.isfinite(row.high):
                axes.plot([place] * 2, [100.0 * row.low, 100.0 * row.high],
                          color=EXTENDED, linewidth=2)  # fmt: skip
            axes.plot(place, gain, "o", color=EXTENDED, markersize=7)
        axes.axhline(0.0, color=INK, linewidth=1)
        _horizons(axes, rows)
        axes.set_ylabel("error taken away, %")
        low, high = axes.get_ylim()
        axes.set_ylim(min(low, -5.0), max(high + 3.0, 5.0))

    return draw(paint)


def joint_gain_picture(rows: Sequence[Horizon]) -> str:
    """Held-out error of every joint at one horizon, before and after."""

    def paint(axes: Axes) -> None:
        for place, row in enumerate(rows):
            before, after = math.degrees(row.before), math.degrees(row.after)
            axes.plot([before, after], [place] * 2, color=EXTENDED, linewidth=1.6)
            axes.plot(
                before, place, "|", color=NOMINAL, markersize=11, markeredgewidth=2.5
            )
            axes.plot(after, place, "o", color=EXTENDED, markersize=6)
        _named_rows(axes, [row.joint for row in rows])
        axes.set_xlabel("held-out error (rms), degrees")

    return draw(paint, height=0.9 + 0.28 * len(rows))


def gain_of(row: Horizon) -> float:
    """Share of the error that the extension takes away; nan if there was none."""
    return 1.0 - row.after / row.before if row.before > 0.0 else math.nan


def ahead(row: Horizon) -> str:
    """A horizon in words."""
    if not math.isfinite(row.seconds):
        return "whole log"
    return f"{row.seconds:.3g} s"


def _horizons(axes: Axes, rows: Sequence[Horizon]) -> None:
    axes.set_xticks(range(len(rows)), [ahead(row) for row in rows])
    axes.set_xlim(-0.6, len(rows) - 0.4)
    axes.set_xlabel("simulated ahead")
    axes.grid(axis="x", visible=False)


def _named_rows(axes: Axes, names: Sequence[str]) -> None:
    axes.set_yticks(range(len(names)), names)
    axes.set_ylim(len(names) - 0.4, -0.6)
    axes.set_xlim(left=0.0)
    axes.grid(axis="y", visible=False)
