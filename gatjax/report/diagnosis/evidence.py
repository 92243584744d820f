"""The upper parts of the page: verdict, key numbers, location."""

from __future__ import annotations

import math

from gatjax.report.diagnosis.bars import location_picture, signal_picture
from gatjax.report.diagnosis.frame import bar, folded, gallery, key, picture
from gatjax.report.diagnosis.quantities import degrees, interval, portion, size, title
from gatjax.report.diagnosis.read import Cause, Diagnosis, Joint, number_in
from gatjax.report.sections import section
from gatjax.report.wording import DASH, escape, number, percent

BADGES = {
    "none": ("better", "the logs agree with the model"),
    "named": ("better", "cause named"),
    "ambiguous": ("unclear", "several causes fit, these logs cannot decide"),
    "unknown": ("unclear", "real, but nothing in the catalogue explains it"),
}
MOST_JOINTS = 30
CARDS = 6  # causes with a box of their own


def head(diagnosis: Diagnosis) -> str:
    """The verdict in one sentence, and the key numbers."""
    robot = str(diagnosis.raw.get("robot") or "unknown robot")
    kind, words = BADGES.get(diagnosis.verdict, ("", "no verdict"))
    refuted = any(row.get("borne_out") is False for row in diagnosis.rows("causes"))
    left = bool(diagnosis.part("unexplained").get("significant"))
    if diagnosis.verdict == "ambiguous" and left:
        words = "something is left that no cause explains"
    if diagnosis.verdict == "ambiguous" and refuted:
        words = "does not predict the held-out logs as the right cause would"
    first, _, rest = sentence(diagnosis).partition("; ")
    also = f'<p class="also">{escape(rest[:1].upper() + rest[1:])}</p>' if rest else ""
    boxes = "".join(cards(diagnosis))
    return (
        f'<header><p class="name">gatjax diagnosis, robot: {escape(robot)}</p>'
        f"<h1>{escape(first)}</h1>{also}"
        f'<p><span class="badge {kind}">{escape(words)}</span></p>'
        f'<div class="cards">{boxes}</div></header>'
    )


def sentence(diagnosis: Diagnosis) -> str:
    """The verdict in words; made from the causes if the file has none."""
    written = diagnosis.raw.get("sentence")
    if isinstance(written, str) and written.strip():
        return written.strip()
    names = " and ".join(title(cause) for cause in diagnosis.causes)
    return {
        "none": "The logs agree with the model within what its tolerances explain.",
        "named": f"The simulation lacks {names}.",
        "ambiguous": f"The simulation lacks something like {names}, or its equivalent.",
        "unknown": "The simulation lacks something that no known cause explains.",
    }.get(diagnosis.verdict, "diagnosis.json holds no verdict.")


def cards(diagnosis: Diagnosis) -> list[str]:
    """Key numbers: causes, their probability, held-out gain, what is left."""
    laws: dict[tuple[str, str], list[Cause]] = {}
    for cause in diagnosis.causes:
        laws.setdefault((cause.name, cause.variant), []).append(cause)
    groups = list(laws.values())
    boxes = [_cause_card(group) for group in groups[:CARDS]]
    if more := [title(group[0]) for group in groups[CARDS:]]:
        boxes.append(_card("other", "besides", f"{len(more)} more", ", ".join(more)))
    gain = diagnosis.part("gain")
    before, after = number_in(gain, "before"), number_in(gain, "after")
    if before > 0.0 and math.isfinite(after):
        words = f"{degrees(before)} before, {degrees(after)} after"
        if diagnosis.verdict == "none":
            floor = degrees(number_in(gain, "noise_floor"))
            words = f"of the nominal model; noise floor {floor}"
            boxes.append(_card("guided", "held-out error", degrees(before), words))
        else:
            value = f"{number(100.0 * (1.0 - after / before), 0)} %"
            label = "held-out error taken away"
            boxes.append(_card("guided", label, value, words))
    rest = diagnosis.part("unexplained")
    share = number_in(rest, "share")
    if math.isfinite(share):
        found = "significant" if rest.get("significant") else "not significant"
        boxes.append(
            _card("other", "left unexplained in fit logs", percent(share), found)
        )
    return boxes


def _cause_card(causes: list[Cause]) -> str:
    """A cause with its size, or with the sizes that it has at several places."""
    first = causes[0]
    mains = sorted(cause.values[0] for cause in causes if cause.values)
    sizes = [size(main.value, main.unit) for main in (*mains[:1], *mains[-1:])]
    words = [f"{interval(mains[0])} (90 %)"] if mains and interval(mains[0]) else []
    if len(causes) > 1:
        words = [f"{len(causes)} values"]
    sure = min(cause.probability for cause in causes)
    if math.isfinite(sure):
        words.append(f"probability {percent(sure)}")
    where = [joint for cause in causes for joint in cause.where]
    value = " to ".join(dict.fromkeys(sizes)) or DASH
    return _card("gat", title(first._replace(where=where)), value, ", ".join(words))


def _card(colour: str, label: str, value: str, words: str) -> str:
    return (
        f'<div style="--mark: var(--{colour})"><span>{escape(label)}</span>'
        f"<b>{escape(value)}</b><span>{escape(words)}</span></div>"
    )


def location(diagnosis: Diagnosis) -> str:
    """Which joints, and how much of it tolerances cannot explain."""
    heading = "Where: residual of every joint"
    joints = sorted(diagnosis.joints, key=excess, reverse=True)
    if not joints:
        return section(heading, "<p>No residuals per joint were written.</p>")
    shown = joints[:MOST_JOINTS]
    head_row = (
        "joint",
        "nominal",
        "after tolerances",
        "with causes",
        "beyond tolerances",
    )
    rows = folded(head_row, [_joint_row(joint) for joint in shown], 8)
    left = len(joints) - len(shown)
    drawn = ", ".join(joint.name for joint in shown if joint.drawn)
    note = (
        "Rms of measured minus simulated on the fit logs, worst joint first. Pale bar: "
        "nominal model. Full bar: what is left after masses, gains and friction were "
        "fitted, each with its tolerance as one standard deviation, up to 3.5 of them. "
        "Dot: with the causes, too. Stroke: noise. All of it of one joint at a time. "
        "The extended model of the pictures and of "
        "the gain has the causes and the calibration, not the masses and small "
        "corrections that were fitted beside them, so it leaves somewhat more. "
        "Beyond tolerances: share of the power left after tolerances that is more than "
        "a right model leaves."
        + (f" {left} quieter joints are left out." if left else "")
        + (
            f" {escape(drawn)}: drawn to the measured motion in these fits (no servo "
            f"holds it, or stick and play part two runs for good); open loop, as in "
            f"the pictures, more is left."
            if drawn
            else ""
        )
    )
    keys = key(
        ("none", "nominal (full: after tolerances)"),
        ("gat", "with causes"),
        ("ink", "noise"),
    )
    shape = picture("Residual by joint", location_picture(shown))
    body = gallery([shape, f"<div>{rows}</div>"])
    body = f"{keys}{body}<p class=note>{note}</p>{_signals(diagnosis)}"
    return section(heading, body)


def _signals(diagnosis: Diagnosis) -> str:
    """Residuals of what is logged besides angles: speeds, torques, inertial unit."""
    rows = diagnosis.rows("signals")
    if not rows:
        return ""
    names = ("nominal_rms", "tolerance_rms", "extended_rms", "noise")
    lines = [
        (
            escape(str(row.get("name", ""))),
            *(
                escape(size(number_in(row, name), str(row.get("unit"))))
                for name in names
            ),
        )
        for row in rows
    ]
    head_row = ("signal", "nominal", "after tolerances", "extended", "noise")
    cells = f"<div>{folded(head_row, lines, 12)}</div>"
    shape = picture("Residual by signal", signal_picture(rows))
    return gallery([shape, cells])


def excess(joint: Joint) -> float:
    """Residual that tolerances leave, rad; for ordering joints."""
    candidates = (joint.tolerance, joint.nominal)
    return next((value for value in candidates if math.isfinite(value)), 0.0)


def _joint_row(joint: Joint) -> list[str]:
    rms = (joint.nominal, joint.tolerance, joint.extended)
    beyond = portion(joint.beyond) + bar(joint.beyond, "none")
    return [escape(joint.name), *(degrees(value) for value in rms), beyond]


def worst(diagnosis: Diagnosis, most: int = 2) -> list[str]:
    """Joints to draw: named ones and one that is left, else the largest residuals."""
    known = diagnosis.signals.joints if diagnosis.signals is not None else {}
    named = [joint for cause in diagnosis.causes for joint in cause.where]
    named = [joint for joint in dict.fromkeys(named) if joint in known]
    ranked = sorted(diagnosis.joints, key=excess, reverse=True)
    others = [joint.name for joint in ranked if joint.name in known]
    rest = diagnosis.part("unexplained")
    left = set(rest.get("where") or []) if rest.get("significant") else set()
    left = [name for name in others if name in left - set(named)]
    chosen = [*named[:most], *left[: 1 if named else most]]
    return chosen or (others or list(known))[:most]
