"""The lower parts of the page: what is left, calibration, advice, checks, files."""

from __future__ import annotations

import math
from typing import Any

from gatjax.effects.catalogue import CATALOGUE
from gatjax.report.diagnosis.frame import bar, folded, signed_bar, table
from gatjax.report.diagnosis.quantities import (
    cause_name,
    degrees,
    place,
    portion,
    size,
)
from gatjax.report.diagnosis.read import Diagnosis, number_in, rows_of, texts_of
from gatjax.report.sections import section
from gatjax.report.wording import DASH, duration, escape, number, percent, significant

SHOWN = 12  # rows before a table folds
ABSOLUTE = (
    "encoder zero",
    "encoder zero, seen by the servo",
    "transport of commands",
)  # the others are factors
MOST = 3.0  # tolerances that fill a bar
FAR = 2.0  # tolerances, standard deviations: a number that is off by more is marked
LEVELS = ("refuse", "warning", "info")
WORDS = {"refuse": "refused", "warning": "warning", "info": "fact"}


def unexplained(diagnosis: Diagnosis) -> str:
    """What the extension leaves, and on which variables it depends."""
    rest = diagnosis.part("unexplained")
    if not rest:
        return ""
    share = number_in(rest, "share")
    words = (
        "What is left is more than noise and tolerances explain."
        if rest.get("significant")
        else "What is left is within noise and tolerances."
    )
    if math.isfinite(share):
        words += (
            f" Beyond the noise, it is {percent(share)} of the power that tolerances "
            f"alone leave."
        )
    where = ", ".join(map(str, rest.get("where") or []))
    if where:
        words += f" It is at {where}, worst joint below."
    if rest.get("law"):
        words += f" A law that is no cause of the catalogue suits it: {rest['law']}."
    body = f"<p>{escape(words)}</p>"
    rows = [
        (
            escape(str(row.get("variable", ""))),
            portion(number_in(row, "share")) + bar(number_in(row, "share"), "other"),
        )
        for row in rows_of(rest.get("depends_on"))
    ]
    if rows:
        body += table(("depends on", "share of what is left"), rows)
    if rest.get("term"):
        body += (
            f"<p>Proposed term, from a sparse regression on the residual: "
            f"<b>{escape(rest['term'])}</b></p>"
        )
    return section("What is left", body + _fallback(diagnosis.part("fallback")))


def _fallback(offer: dict[str, Any]) -> str:
    """The learned correction that is offered instead of a cause."""
    if not offer:
        return ""
    words = (
        "A learned correction of the commands (GAT) is not proven to predict rows that "
        "it has not seen better."
    )
    if offer.get("world"):
        words = (
            f"Until the cause is known, a learned correction of the commands (GAT, "
            f"alpha {number(number_in(offer, 'alpha'), 1)}) can take its place: give "
            f"{offer['world']} as --world."
        )
    if "after" in offer:
        before, after = (degrees(number_in(offer, k)) for k in ("before", "after"))
        low, high = (number(100.0 * number_in(offer, k), 0) for k in ("low", "high"))
        words += (
            f" On the held-out logs it takes the error of the extended model from "
            f"{before} to {after} (95 % interval of the gain: {low} to {high} %)."
        )
    return f"<p>{escape(words)}</p>"


def calibration(diagnosis: Diagnosis) -> str:
    """Nominal numbers that were fitted with their tolerances; no causes."""
    rows = diagnosis.rows("calibration")
    if not rows:
        return ""

    def used(row: dict[str, Any]) -> float:
        before, after = number_in(row, "nominal"), number_in(row, "fitted")
        tolerance = number_in(row, "tolerance")
        if not tolerance > 0.0:
            return math.nan
        if row.get("parameter") in ABSOLUTE or min(before, after) <= 0.0:
            return (after - before) / tolerance
        return math.log(after / before) * before / tolerance

    def weight(row: dict[str, Any]) -> float:
        return abs(used(row)) if math.isfinite(used(row)) else 0.0

    lines = []
    for row in sorted(rows, key=weight, reverse=True):
        share, unit = used(row), str(row.get("unit", ""))
        cells = [escape(str(row.get("parameter", "")).replace("_", " "))]
        cells.append(escape(place(texts_of(row.get("where")))))
        cells += [
            escape(size(number_in(row, name), unit)) for name in ("nominal", "fitted")
        ]
        tolerance = size(number_in(row, "tolerance"), unit)
        cells.append(f"&plusmn; {escape(tolerance)}" if tolerance != DASH else DASH)
        change = f"{number(100.0 * share, 0, sign=True)} %"
        change += "<small>beyond its tolerance</small>" if abs(share) > FAR else ""
        cells.append(
            change + signed_bar(share / MOST, "theta0") if share == share else DASH
        )
        lines.append(cells)
    head = ("number", "where", "nominal", "fitted", "tolerance", "tolerance used")
    note = (
        "<p class=note>These nominal numbers were fitted, each with its tolerance as "
        "one standard deviation, up to 3.5 of them. They are calibration and no "
        "findings; a bar at either end means that the number is off by three "
        "tolerances or more. world.json has them if the simulation predicts better "
        "with them. Numbers that do the same to these logs, as damping of servo and "
        "joint do, may move against "
        "each other.</p>"
    )
    return section("Calibration", folded(head, lines, SHOWN) + note)


def next_experiment(diagnosis: Diagnosis) -> str:
    """The motion that separates the leading explanations best."""
    advice = diagnosis.part("next_experiment")
    if not advice:
        return ""
    motion = str(advice.get("motion", ""))
    pair = " from ".join(cause_name(c) for c in texts_of(advice.get("separates"))[:2])
    words = f"Record the motion {motion}" if motion else "Record another motion"
    words += f": it separates {pair}." if pair else "."
    body = f"<p><b>{escape(words)}</b> {escape(str(advice.get('why', '')))}</p>"
    apart = number_in(advice, "separation")
    if math.isfinite(apart):
        body += (
            f"<p class=note>Expected separation: {significant(apart)} noise units (3 "
            f"would decide).</p>"
        )
    command = str(advice.get("command", ""))
    if command:
        body += (
            f"<pre>{escape(command)}</pre><p class=note>plays it in the extended "
            f"simulation. The command columns of its file are the targets to play on "
            f"the robot; add the log of that to the data and diagnose again.</p>"
        )
    return section("Next experiment", body)


def smallest_effects(diagnosis: Diagnosis) -> str:
    """For every cause the least effect that these logs could have shown."""
    lines = []
    for row in diagnosis.rows("smallest_effects"):
        cause = cause_name(str(row.get("cause", "")))
        parameter = str(row.get("parameter", "")).replace("_", " ")
        amount = escape(_least(row))
        if row.get("at_most"):
            amount += "<small>the smallest that is looked for</small>"
        lines.append(
            (
                f"{escape(cause)}<small>{escape(parameter)}</small>",
                amount,
                escape(place(texts_of(row.get("where")))),
            )
        )
    if not lines:
        return ""
    head = ("cause", "smallest that shows", "where it shows best")
    note = (
        "<p class=note>Weaker effects than these, and causes that are neither named "
        "nor listed, may be there without being seen: the verdict does not speak of "
        "them.</p>"
    )
    return section(
        "What these logs could have shown", folded(head, lines, SHOWN) + note
    )


def _least(row: dict[str, Any]) -> str:
    """The smallest size of a cause that shows."""
    value, unit = number_in(row, "value"), str(row.get("unit", ""))
    entry = CATALOGUE.get(str(row.get("cause", "")))
    words = size(value, unit)
    if entry is not None and entry.neutral == 1.0:
        return f"{'below' if value < 1.0 else 'above'} {words}"
    return f"below {words}" if entry and math.isinf(entry.neutral) else words


def data_checks(diagnosis: Diagnosis) -> str:
    """What the checks of the files found, warnings first."""
    rows = diagnosis.rows("data_checks")
    if not rows:
        return ""
    lines = {
        level: [
            (
                WORDS[level],
                escape(str(row.get("check", ""))),
                escape(row.get("text", "")),
            )
            for row in rows
            if row.get("level", "info") == level
        ]
        for level in LEVELS
    }
    head = ("", "check", "what it says")
    grave = [*lines["refuse"], *lines["warning"]]
    body = table(head, grave) if grave else "<p>No warning; the logs look sound.</p>"
    if lines["info"]:
        body += f"<details><summary>{len(lines['info'])} facts about the logs</summary>"
        body += f"{table(head, lines['info'])}</details>"
    return section("Data checks", body)


def made_of(diagnosis: Diagnosis) -> str:
    """Files, and how the diagnosis was made."""
    files = diagnosis.part("files")
    rows = [
        ("fitted to", ", ".join(texts_of(files.get("fit"))) or DASH),
        ("held out", ", ".join(texts_of(files.get("held_out"))) or DASH),
        ("robot", str(diagnosis.raw.get("robot") or DASH)),
        ("time", duration(number_in(diagnosis.raw, "seconds"))),
    ]
    for name, value in diagnosis.part("made_by").items():
        if value is not None:
            rows.append((str(name), str(value)))
    lines = [[escape(cell) for cell in row] for row in rows]
    cells = "".join(f"<tr><td>{a}</td><td>{b}</td></tr>" for a, b in lines)
    body = (
        f'<div class=scroll><table class="facts"><tbody>{cells}</tbody></table></div>'
    )
    lost = texts_of(diagnosis.raw.get("not_expressible"))
    if lost:
        items = "".join(f"<li>{escape(each)}</li>" for each in lost)
        body += (
            f"<h3>In world.json but not in extended.xml, which cannot say it"
            f"</h3><ul>{items}</ul>"
        )
    return section("Files and how this was made", body)
