"""The part of the page on held-out logs: what the extension is worth."""

from __future__ import annotations

import math
from collections.abc import Sequence

from gatjax.report.diagnosis.bars import (
    ahead,
    error_picture,
    gain_of,
    gain_picture,
    joint_gain_picture,
)
from gatjax.report.diagnosis.frame import gallery, key, picture
from gatjax.report.diagnosis.quantities import degrees
from gatjax.report.diagnosis.read import Diagnosis, Horizon, number_in, texts_of
from gatjax.report.sections import section
from gatjax.report.wording import DASH, escape, number, percent

HEADING = "What it is worth on held-out logs"
MOST_JOINTS = 30


def gain_section(diagnosis: Diagnosis) -> str:
    """Held-out error before and after, by horizon and by joint."""
    gain = diagnosis.part("gain")
    floor = number_in(gain, "noise_floor")
    ceiling = number_in(gain, "learned_ceiling")
    rows = sorted(diagnosis.horizons, key=lambda row: row.seconds)
    every = [row for row in rows if row.joint == "all"]
    if not every and number_in(gain, "before") > 0.0:
        numbers = (number_in(gain, name) for name in ("before", "after", "low", "high"))
        every = [Horizon(math.inf, "all", *numbers, learned=ceiling)]
    if not every:
        held = texts_of(diagnosis.part("files").get("held_out"))
        words = "No held-out logs were given, so no gain."
        if held:
            words = "A robot falls at the start of the held-out logs, so no gain."
        return section(HEADING, f"<p>{words}</p>")
    shown = [
        picture("Error of all joints", error_picture(every, floor)),
        picture("Gain with its 95 % interval", gain_picture(every)),
    ]
    shown += _by_joint(rows)
    body = f"<p>{escape(_words(diagnosis) + _losers(rows))}</p>"
    colours = [("none", "nominal model"), ("gat", "extended model")]
    colours += [("ink", "noise floor")] if math.isfinite(floor) else []
    learnable = any(row.learnable for row in every)
    colours += [("guided", "learned model")] if learnable else []
    body += key(*colours) + gallery(shown)
    own = [row for row in rows if row.joint != "all"]
    single = f"<details><summary>Every joint</summary>{_table(own)}</details>"
    body += _table(every) + (single if own else "")
    return section(HEADING, body + _note(floor, ceiling, every[-1].before))


def _by_joint(rows: Sequence[Horizon]) -> list[str]:
    """Pictures of every joint at the two longest horizons, worst joint first."""
    own = [row for row in rows if row.joint != "all"]
    pictures = []
    for seconds in sorted({row.seconds for row in own})[-2:]:
        there = [row for row in own if row.seconds == seconds]
        there.sort(key=lambda row: max(row.before, row.after), reverse=True)
        left = len(there) - MOST_JOINTS
        words = f"{left} joints that err less are left out." if left > 0 else ""
        svg = joint_gain_picture(there[:MOST_JOINTS])
        pictures.append(picture(f"Error by joint, {ahead(there[0])}", svg, words))
    return pictures


def _words(diagnosis: Diagnosis) -> str:
    """Whether the extension is promoted, and what share of it was learnable."""
    gain = diagnosis.part("gain")
    words = []
    if not diagnosis.causes:
        words.append(
            "No cause was named. What the extended model gains comes from nominal "
            "numbers that were fitted again, as far as their tolerances let them."
        )
    elif "promoted" in gain:
        words.append(
            "The extended model is the one to use from here on (world.json): it "
            "predicts logs that it was not fitted to measurably better."
            if gain["promoted"]
            else "The extended model is not one to use yet: the interval of its gain "
            "reaches down to zero or below, so keep the nominal model."
        )
    alone = number_in(gain, "without_calibration")
    if math.isfinite(alone):
        words.append(
            f"Without the numbers that were fitted again beside them (calibration), "
            f"with the named causes alone, the error is {degrees(alone)}."
        )
    share = number_in(gain, "learned_share")
    if 0.0 < share <= 1.0 and diagnosis.verdict != "none":
        words.append(
            f"It explains {percent(share)} of what a learned model takes away on the "
            f"same logs."
        )
    if share > 1.0 and diagnosis.verdict != "none":
        words.append("It takes away more than a model that is learned from the logs.")
    files = diagnosis.part("files")
    held = texts_of(files.get("held_out"))
    if held:
        words.append(f"Measured on {', '.join(held[:4])}.")
    return " ".join(words)


def _losers(rows: Sequence[Horizon]) -> str:
    """Joints that the extended model predicts worse over the longest horizon."""
    longest = max(row.seconds for row in rows) if rows else math.nan
    worse = [
        row.joint for row in rows
        if row.joint != "all" and row.seconds == longest and row.high < 0.0
    ]  # fmt: skip
    return f" It predicts {', '.join(worse)} worse than before." if worse else ""


def _note(floor: float, ceiling: float, nominal: float) -> str:
    words = (
        "Replay of the recorded commands, started anew at every horizon; error is the "
        "rms over joints and time. Gain is 1 - after / before. "
    )
    if math.isfinite(floor):
        words += f"Noise floor {degrees(floor)}: about what a right model leaves. "
    if math.isfinite(ceiling):
        words += (
            f"Learned model (GAT forward model, trained on the fit logs): "
            f"{degrees(ceiling)} on the whole log"
        )
        worse = ceiling > nominal
        words += ", worse than the nominal model. " if worse else ". "
    return f"<p class=note>{escape(words)}</p>"


def _table(rows: list[Horizon]) -> str:
    lines = ""
    for row in rows:
        ends = DASH
        if math.isfinite(row.low) and math.isfinite(row.high):
            low, high = (number(100.0 * end, 0) for end in (row.low, row.high))
            ends = f"{low} to {high} %"
        gain = 100.0 * gain_of(row)
        lines += (
            f"<tr><td>{escape(ahead(row))}</td><td>{escape(row.joint)}</td>"
            f"<td class=n>{degrees(row.before)}</td>"
            f"<td class=n>{degrees(row.after)}</td>"
            f"<td class=n>{degrees(row.learned)}</td>"
            f"<td class=n>{number(gain, 0)} %</td><td class=n>{ends}</td></tr>"
        )
    head = "<tr><th>simulated ahead</th><th>joint</th><th class=n>before</th>"
    head += "<th class=n>after</th><th class=n>learned model</th><th class=n>gain</th>"
    head += "<th class=n>95 % interval</th></tr>"
    return (
        f"<div class=scroll><table><thead>{head}</thead><tbody>{lines}</tbody></table>"
        f"</div>"
    )
