"""The parts of the page that compare the methods: cards, table and animation."""

from __future__ import annotations

import json
import math

from gatjax.report.intervals import Interval
from gatjax.report.read import THETA0
from gatjax.report.tables import (
    LABELS,
    PAPER,
    PAPER_THETA0,
    Method,
    Summary,
    label_of,
    speed,
)
from gatjax.report.verdict import evidence
from gatjax.report.walks import Walk, pack_walks
from gatjax.report.wording import DASH, escape, number, percent, span


def section(title: str, body: str) -> str:
    """One framed part of the page."""
    return f"<section><h2>{escape(title)}</h2>{body}</section>"


def mark(method: str) -> str:
    """Style attribute that sets the colour of a method."""
    name = method if method in LABELS else "other"
    return f'style="--mark: var(--{name})"'


def swatch(method: str) -> str:
    """A coloured square and the name of a method."""
    square = f'<span class="swatch" {mark(method)}></span>'
    return f'<span class="method">{square}{escape(label_of(method))}</span>'


def cards(summary: Summary) -> str:
    """The key number of theta0 and of every method."""
    boxes = []
    theta0 = summary.theta0
    if theta0 is not None and theta0.velocity is not None:
        fell = f"{theta0.falls} of {theta0.rollouts} walks fell"
        boxes.append(_card(THETA0, theta0.velocity.mean, fell))
    for method in summary.methods:
        if not method.evaluated:
            continue
        words = []
        if method.gain is not None:
            words.append(f"{number(method.gain.mean, 0, sign=True)} %")
        words.append(evidence(method))
        if method.falls is not None:
            words.append(f"{percent(method.falls.share.mean)} falls in the search")
        boxes.append(_card(method.name, speed(method), ", ".join(words)))
    return f'<div class="cards">{"".join(boxes)}</div>' if boxes else ""


def _card(method: str, velocity: float, words: str) -> str:
    value = f"{number(velocity)} <small>cm/s</small>"
    if not math.isfinite(velocity):
        value = DASH
    name = escape(label_of(method))
    return (
        f"<div {mark(method)}><span>{name}</span><b>{value}</b>"
        f"<span>{escape(words)}</span></div>"
    )


def method_table(summary: Summary, below: str = "") -> str:
    """Every method on the robot, with the paper's numbers beside it, and a note."""
    first = summary.ranked[0] if summary.ranked else None
    rows = [_theta0_row(summary)]
    rows += [_method_row(each, each is first) for each in summary.methods]
    what = "fastest walk without a fall"
    if summary.confirmed:
        what = "winner walked again,<br>fresh seeds"
    head = (
        f"<tr><th>method</th><th class=n>{what}, cm/s</th>"
        "<th class=n>gain over theta0</th>"
        "<th class=n>falls in search<br>after the first<br>generation</th>"
        "<th>found in</th>"
        "<th class='n paper'>paper:<br>gain</th>"
        "<th class='n paper'>paper:<br>failed trials</th></tr>"
    )
    body = f"<div class=scroll><table><thead>{head}</thead>"
    body += f"<tbody>{''.join(rows)}</tbody></table></div>"
    return section("Methods on the robot", body + below + method_notes(summary))


def method_notes(summary: Summary) -> str:
    """How to read the table: where each number comes from and what it cannot say."""
    confirmed = (
        "Each winner, the fastest candidate without a fall, walked again with fresh "
        "seeds, and only those walks give its velocity and gain; a fall there is shown "
        "and not forgiven. Where it says not confirmed, the winner was measured on the "
        "walks that it was picked by, which flatter it."
        if summary.confirmed
        else "The winners were not confirmed: each is the fastest of several "
        "candidates and measured on the same walks that it was picked by, which "
        "flatter it. Its next walks will be slower."
    )
    return (
        f"<p class=note>{confirmed} Winners come from generations after the first "
        "where there are any.</p>"
        "<p class=note>Small print: 95 % intervals (velocities: Student t over walks; "
        "gains: Fieller's interval of a ratio, so the error of theta0 counts too). "
        "Velocity is that of the walks without a fall. Falls are pooled over all "
        "candidates of the search, of all generations after the first of an iteration. "
        " Their interval takes candidates as samples (Wilson where all "
        "agree), but these are one path of one search and not independent: it does not "
        "say how the next search would fare. The comparison named in advance is "
        f"{escape(label_of(summary.grounded))} against no grounding.</p>"
        "<p class=note>Paper: Hanna and Stone 2017, table 1, SimSpark to Gazebo, mean "
        "gain of 10 trials, over generations after the first, and trials without a "
        "stable improvement; a run of this program is one trial. theta0 walked "
        f"{PAPER_THETA0} cm/s on the physical NAO. Their robot is another one: compare "
        "the order of the methods rather than the sizes. The noise envelope here is a "
        "variant of theirs: its size per joint is the plain simulator's one-step error "
        "on the robot's recordings, theirs is N(0, 1).</p>"
    )


def _theta0_row(summary: Summary) -> str:
    theta0 = summary.theta0
    speed = falls = DASH
    if theta0 is not None:
        falls = f"{percent(theta0.falls / theta0.rollouts)}"
        falls += f"<small>{theta0.falls} of {theta0.rollouts}</small>"
        if theta0.velocity is not None:
            speed = number(theta0.velocity.mean)
            speed += f"<small>{span(theta0.velocity)}</small>"
    return (
        f"<tr><td>{swatch(THETA0)}<small>start of the search</small></td>"
        f"<td class=n>{speed}</td><td class=n>{DASH}</td><td class=n>{falls}</td>"
        f"<td>{DASH}</td><td class='n paper'>{PAPER_THETA0} cm/s</td>"
        f"<td class='n paper'>{DASH}</td></tr>"
    )


def _method_row(method: Method, fastest: bool) -> str:
    gain, falls = method.gain, method.falls
    share = grown = DASH
    if gain is not None:
        ends = span(gain, sign=True)
        grown = f"{number(gain.mean, sign=True)} %<small>{ends}</small>"
    if falls is not None:
        ends = span(Interval(*(100.0 * end for end in falls.share)), 0)
        share = f"{percent(falls.share.mean)}<small>{falls.count} of {falls.rollouts}"
        share += f" ({ends} %)</small>"
    paper = PAPER.get(method.name)
    papers = [DASH, DASH]
    if paper is not None:
        papers[0] = f"{number(paper.gain, sign=True)} %"
        papers[0] += f"<small>generation {paper.generation}</small>"
        papers[0] += f"<small>{escape(paper.remark)}</small>" if paper.remark else ""
        papers[1] = f"{paper.failed} of 10"
    return (
        f"<tr{' class=first' if fastest else ''}><td>{swatch(method.name)}</td>"
        f"<td class=n>{_speed_cell(method)}</td>"
        f"<td class=n>{grown}</td><td class=n>{share}</td>"
        f"<td class=whole>{_found_cell(method)}</td>"
        f"<td class='n paper'>{papers[0]}</td><td class='n paper'>{papers[1]}</td></tr>"
    )


def _speed_cell(method: Method) -> str:
    best = method.best
    if best is None:
        why = evidence(method) if method.evaluated else "not evaluated"
        return f"{DASH}<small>{why}</small>"
    if best.velocity is None:
        return f"{DASH}<small>every walk fell</small>"
    return f"{number(best.velocity.mean)}<small>{span(best.velocity)}</small>"


def _found_cell(method: Method) -> str:
    best = method.best
    if best is None:
        return DASH
    found = f"generation {best.generation}"
    if any(each.iteration for each in method.candidates):
        found += f", iteration {best.iteration}"
    words = evidence(method)
    if not method.confirmed:
        words = f"{best.candidate} candidate, {best.rollouts} walks, not confirmed"
    return f"{found}<small>{escape(words)}</small>"


def animation(walks: list[Walk]) -> str:
    """The first and the best walk side by side; one alone if there is no other."""
    title = "The walk" if len(walks) == 1 else "The first and the best walk"
    if not walks:
        return section(
            title,
            "<p>No walk to show: none was kept, or nobody saw where the robot was, "
            "which takes motion capture.</p>",
        )
    data = json.dumps(pack_walks(walks), allow_nan=False).replace("<", "\\u003c")
    intro = (
        "<p class=note>Drag to turn the view, double-click to reset it. The number is "
        "the distance from the start; lines on the floor are half a metre apart.</p>"
    )
    body = f'{intro}<div id="viewer"></div><noscript>The animation needs javascript.'
    body += f'</noscript><script type="application/json" id="walks">{data}</script>'
    return section(title, body)
