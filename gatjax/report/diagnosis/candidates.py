"""What was weighed for each cause, and why the others lost."""

from __future__ import annotations

import math
from itertools import groupby

from gatjax.report.diagnosis.frame import bar
from gatjax.report.diagnosis.quantities import degrees, portion, size, title
from gatjax.report.diagnosis.read import Cause, Diagnosis, texts_of
from gatjax.report.sections import section
from gatjax.report.wording import DASH, escape, number

HEADING = "Evidence: which causes were weighed"
SHOWN = 5  # candidates for each cause
CLOSE = 3.0  # difference of log evidence below which nothing is decided
SURE = 0.8  # probability from which a cause is named
HEAD = (
    "<tr><th>cause</th><th class=n>size</th><th>probability</th>"
    "<th class=n>log evidence,<br>nats</th>"
    "<th class=n>residual<br>left, rms</th><th>why</th></tr>"
)


def candidate_table(diagnosis: Diagnosis) -> str:
    """Every cause that was weighed, step by step, and why the others lost."""
    every = diagnosis.candidates
    if not every:
        return section(HEADING, "<p>No candidates were written.</p>")
    steps = [list(group) for _, group in groupby(every, lambda each: each.step)]
    groups = "".join(_group(g, n, diagnosis) for n, g in enumerate(steps, start=1))
    more = sum(max(0, len(group) - SHOWN) for group in steps)
    note = f"{more} weaker candidates are in diagnosis.json. " if more else ""
    note += (
        "Log evidence is what a cause predicts of these logs beyond what was known "
        "before it, with its free numbers paid for. Probabilities take half of it: "
        "among the candidates of one cause, 3 less is 4.5 times less likely, 7 less 33 "
        "times."
    )
    table = f"<table class=weighed><thead>{HEAD}</thead>{groups}</table>"
    body = f"<div class=scroll>{table}</div>"
    return section(HEADING, f"{body}<p class=note>{note}</p>")


def _group(group: list[Cause], number: int, diagnosis: Diagnosis) -> str:
    """What was weighed for one cause, the best few; or beside all of them."""
    first, causes = group[0], diagnosis.causes
    named = next((cause for cause in causes if _names(cause, first)), None)
    words = "Weighed besides, not named" if causes else "Weighed, not named"
    if named is not None:
        words = f"Cause {number}"
    rest = diagnosis.part("unexplained")
    where = texts_of(rest.get("where")) if rest.get("significant") else []
    left = not set(where).isdisjoint(first.where)
    rows = "".join(
        _row(each, reason(each, first, named, left), each is first)
        for each in group[:SHOWN]
    )
    return f"<tbody><tr><th colspan=6>{words}</th></tr>{rows}</tbody>"


def _names(cause: Cause, first: Cause) -> bool:
    """Whether a cause, or one of its values, is what a step ended with."""
    same = (cause.name, cause.variant) == (first.name, first.variant)
    whole = "all" in {*cause.where, *first.where}
    there = whole or not set(cause.where).isdisjoint(first.where)
    return same and there and math.isfinite(first.probability)


def _row(each: Cause, why: str, first: bool) -> str:
    main = each.values[0] if each.values else None
    name = escape(title(each))
    if each.variant:
        name += f"<small>{escape(each.variant)}</small>"
    amount = size(main.value, main.unit) if main else DASH
    known = math.isfinite(each.probability)
    chance = portion(each.probability) + (bar(each.probability, "gat") if known else "")
    return (
        f"<tr{' class=first' if first and known else ''}><td>{name}</td>"
        f"<td class=n>{escape(amount)}</td><td>{chance}</td>"
        f"<td class=n>{number(each.evidence)}</td>"
        f"<td class=n>{degrees(each.rms)}</td><td>{escape(why)}</td></tr>"
    )


def reason(each: Cause, first: Cause, named: Cause | None, left: bool) -> str:
    """Why a candidate was or was not named.

    Args:
        each: in question.
        first: what was named in its step, or fits best there.
        named: the cause that was named in its step, if one was.
        left: whether something at the joints of `first` is unexplained in the end.
    """
    if named is None:
        if not (each is first and left):
            return "explains or changes too little to be a finding"
        if each.variant == "not in the catalogue":
            return "fits best, but is no cause of the catalogue"
        return "fits best, but leaves too much to be the explanation"
    if each is first:
        return "named" if each.probability >= SURE else "likely, with a doubt"
    if each.name in named.equivalent:
        return f"cannot be told apart from {title(named)} in these logs"
    lost = first.evidence - each.evidence
    if lost < 0.0:
        return "explains more, but leaves too much or changes too little"
    if lost < CLOSE:
        return f"nearly as good as {title(named)}: these logs cannot decide"
    if each.where[:1] == first.where[:1] and each.rms > 1.15 * first.rms:
        return f"leaves {degrees(each.rms)} where the best leaves {degrees(first.rms)}"
    return "explains less, numbers paid for" if math.isfinite(lost) else ""
