"""The part of the page that shows how a joint behaves."""

from __future__ import annotations

import numpy as np

from gatjax.report.diagnosis import figures
from gatjax.report.diagnosis.evidence import MOST_JOINTS, excess, worst
from gatjax.report.diagnosis.frame import gallery, key, picture
from gatjax.report.diagnosis.read import Diagnosis, Signals, Trace
from gatjax.report.diagnosis.signals import close_up
from gatjax.report.sections import section


def joint_sections(diagnosis: Diagnosis) -> str:
    """Pictures of the named joints, else of the two worst; the others' residuals."""
    signals = diagnosis.signals
    if signals is None:
        return section("How the joints behave", "<p>signals.parquet is missing.</p>")
    drawn = worst(diagnosis)
    named = bool(diagnosis.causes)
    shown = [_joint(name, signals, signals.joints[name], named) for name in drawn]
    return "".join(shown) + _others(diagnosis, signals, drawn)


def _others(diagnosis: Diagnosis, signals: Signals, drawn: list[str]) -> str:
    """Residuals over time of the joints that are not drawn, worst first, folded."""
    ranked = sorted(diagnosis.joints, key=excess, reverse=True)
    left = [j.name for j in ranked if j.name in signals.joints and j.name not in drawn]
    if not left:
        return ""
    shown = [
        picture(name, figures.residual_over_time(signals, signals.joints[name]))
        for name in left[:MOST_JOINTS]
    ]
    count = "joint" if len(shown) == 1 else "joints"
    body = f"<summary>{len(shown)} more {count}</summary>{gallery(shown)}"
    return section("Residual of the other joints", f"<details>{body}</details>")


def _moment(trace: Trace, named: bool) -> str:
    """What a close-up shows; without a named cause nothing but numbers is fitted."""
    if trace.extended is None:
        return "The moment at which the nominal model errs most."
    if not named:
        return (
            "No cause was named: the extended model is the nominal one with numbers "
            "fitted again, and this is the moment at which that gains most."
        )
    return "The moment at which the extended model gains most on the nominal one."


def trend(signals: Signals) -> str:
    """What to see in residuals over time."""
    shaded = "Shaded: held-out. " if signals.held.any() else ""
    return f"{shaded}A trend points to heat, supply or clocks."


def _joint(name: str, signals: Signals, trace: Trace, named: bool) -> str:
    """Every picture of one joint."""
    window = close_up(signals, trace)
    whole = np.flatnonzero(signals.run == signals.run[window[0]])
    log = "held-out log" if signals.held[window[0]] else "fit log"
    shown = [
        picture(
            f"Close-up, {log}",
            figures.overlay(signals, trace, window),
            _moment(trace, named),
        ),
        picture(f"The whole {log}", figures.overlay(signals, trace, whole)),
        picture(
            "Residual over time",
            figures.residual_over_time(signals, trace),
            trend(signals),
        ),
    ]
    loop = figures.hysteresis(signals, trace)
    if loop is not None:
        shown.append(
            picture(
                "Hysteresis in slow motion",
                loop,
                "Solid: command rising, dashed: falling. The distance between them is "
                "friction and play; their slope is load.",
            )
        )
    shown += [
        picture(title, svg)
        for title, svg in figures.residual_pictures(signals, trace).items()
    ]
    shown += [
        picture(title, svg)
        for title, svg in figures.response_pictures(signals, trace).items()
    ]
    sent = [] if trace.command is None else [("faint", "command (dotted)")]
    colours = [("measured", "measured"), *sent, ("none", "nominal model")]
    if trace.extended is not None:
        colours.append(("gat", "extended model"))
    note = (
        "<p class=note>Models are replayed open loop from the first command. Binned "
        "residuals: mean of equally filled bins, band one standard deviation. "
        "Response: averaged cross-spectra, where the command has power.</p>"
    )
    return section(f"Joint {name}", key(*colours) + gallery(shown) + note)
