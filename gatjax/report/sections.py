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
)
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
        if not method.candidates:
            continue
        words = []
        if method.gain is not None:
            words.append(f"{number(method.gain.mean, 0, sign=True)} %")
        if method.falls is not None:
            words.append(f"{percent(method.falls.share.mean)} falls")
        velocity = method.best.velocity if method.best else None
        speed = velocity.mean if velocity else math.nan
        boxes.append(_card(method.name, speed, ", ".join(words)))
    return f'<div class="cards">{"".join(boxes)}</div>' if boxes else ""


def _card(method: str, speed: float, words: str) -> str:
    value = f"{number(speed)} <small>cm/s</small>"
    if not math.isfinite(speed):
        value = "<small>no walk without a fall</small>"
    name = escape(label_of(method))
    return (
        f"<div {mark(method)}><span>{name}</span><b>{value}</b>"
        f"<span>{escape(words)}</span></div>"
    )


def method_table(summary: Summary) -> str:
    """Every method on the robot, with the paper's numbers beside it."""
    speeds = [
        m.best.velocity.mean for m in summary.methods if m.best and m.best.velocity
    ]
    rows = [_theta0_row(summary)]
    rows += [
        _method_row(each, max(speeds, default=math.nan)) for each in summary.methods
    ]
    head = (
        "<tr><th>method</th><th class=n>fastest walk without a fall, cm/s</th>"
        "<th class=n>gain over theta0</th>"
        "<th class=n>falls after the<br>first generation</th><th>found in</th>"
        "<th class='n paper'>paper:<br>gain</th>"
        "<th class='n paper'>paper:<br>failed trials</th></tr>"
    )
    note = (
        "<p class=note>Small print: 95 % intervals (velocities and gains: bootstrap "
        "over walks; falls: bootstrap over candidates, Wilson where all candidates "
        "agree). Velocity counts only candidates that never fell; the fastest of "
        "several is a lucky pick to some degree, so its next walks will be slightly "
        "slower. Falls are pooled over every evaluated candidate, best and mean, of "
        "all generations after the first of an iteration. Paper: Hanna and Stone "
        "2017, table 1, SimSpark to Gazebo, mean gain of 10 trials, over generations "
        "after the first, and trials without a stable improvement; theta0 walked "
        f"{PAPER_THETA0} cm/s on the physical NAO. Their robot is another one: compare "
        "the order of the methods rather than the sizes.</p>"
    )
    body = f"<div class=scroll><table><thead>{head}</thead>"
    body += f"<tbody>{''.join(rows)}</tbody></table></div>{note}"
    return section("Methods on the robot", body)


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


def _method_row(method: Method, fastest: float) -> str:
    best, gain, falls = method.best, method.gain, method.falls
    speed = found = share = grown = DASH
    first = ""
    if best is not None and best.velocity is not None:
        speed = f"{number(best.velocity.mean)}<small>{span(best.velocity)}</small>"
        found = f"generation {best.generation}"
        if any(each.iteration for each in method.candidates):
            found += f", iteration {best.iteration}"
        words = f"{best.candidate} candidate, {best.rollouts} walks"
        found += f"<small>{escape(words)}</small>"
        first = " class=first" if best.velocity.mean == fastest else ""
    elif method.candidates:
        speed = f"{DASH}<small>every candidate fell</small>"
    else:
        speed = f"{DASH}<small>not evaluated</small>"
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
        papers[1] = f"{paper.failed} of 10"
    return (
        f"<tr{first}><td>{swatch(method.name)}</td><td class=n>{speed}</td>"
        f"<td class=n>{grown}</td><td class=n>{share}</td><td class=whole>{found}</td>"
        f"<td class='n paper'>{papers[0]}</td><td class='n paper'>{papers[1]}</td></tr>"
    )


def animation(walks: list[Walk]) -> str:
    """The first and the best walk side by side."""
    title = "The first and the best walk"
    if not walks:
        return section(title, "<p>No walk was recorded for the animation.</p>")
    data = json.dumps(pack_walks(walks), allow_nan=False).replace("<", "\\u003c")
    intro = (
        "<p class=note>Drag to turn the view, double-click to reset it. The number is "
        "the distance from the start; lines on the floor are half a metre apart.</p>"
    )
    body = f'{intro}<div id="viewer"></div><noscript>The animation needs javascript.'
    body += f'</noscript><script type="application/json" id="walks">{data}</script>'
    return section(title, body)
