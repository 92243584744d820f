"""The parts of the page above the facts: cards, methods, pictures and animation."""

from __future__ import annotations

import json
import math
from collections.abc import Sequence

from gatjax.report import figures
from gatjax.report.read import THETA0, Prediction, Run
from gatjax.report.tables import (
    LABELS,
    PAPER,
    PAPER_THETA0,
    Method,
    Summary,
    label_of,
    ordered,
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
    return f'<span class="swatch" {mark(method)}></span>{escape(label_of(method))}'


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
    speeds = [m.best.velocity.mean for m in summary.methods if m.best and m.best.velocity]
    rows = [_theta0_row(summary)]
    rows += [_method_row(each, max(speeds, default=math.nan)) for each in summary.methods]
    head = (
        "<tr><th>method</th><th class=n>fastest walk without a fall, cm/s</th>"
        "<th class=n>gain over theta0</th><th class=n>falls after the<br>first generation"
        "</th><th>found in</th><th class='n paper'>paper:<br>gain</th>"
        "<th class='n paper'>paper:<br>failed trials</th></tr>"
    )
    note = (
        "<p class=note>Small print: 95 % intervals (velocities and gains: bootstrap over "
        "walks; falls: bootstrap over candidates, Wilson where all candidates agree). "
        "Velocity counts only candidates that never fell; the fastest of several is a "
        "lucky pick to some degree, so its next walks will be slightly slower. Falls are "
        "pooled over every evaluated candidate, best and mean, of all generations after "
        "the first of an iteration. Paper: Hanna and Stone 2017, table 1, SimSpark to "
        "Gazebo, mean gain of 10 trials and trials without a stable improvement; theta0 "
        f"walked {PAPER_THETA0} cm/s on the physical NAO. Their robot is another one: "
        "compare the order of the methods rather than the sizes.</p>"
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
            speed = f"{number(theta0.velocity.mean)}<small>{span(theta0.velocity)}</small>"
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
        found += f"<small>{escape(best.candidate)} candidate, {best.rollouts} walks</small>"
        first = " class=first" if best.velocity.mean == fastest else ""
    elif method.candidates:
        speed = f"{DASH}<small>every candidate fell</small>"
    else:
        speed = f"{DASH}<small>not evaluated</small>"
    if gain is not None:
        ends = span(gain, sign=True)
        grown = f"{number(gain.mean, sign=True)} %<small>{ends}</small>"
    if falls is not None:
        ends = span(type(falls.share)(*(100.0 * end for end in falls.share)), 0)
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


def legend(methods: Sequence[str], extra: str = "") -> str:
    """The colours of a picture, in html."""
    names = "".join(f"<span>{swatch(name)}</span>" for name in methods)
    return f'<div class="legend">{names}{extra}</div>'


def _picture(title: str, svg: str) -> str:
    label = escape(title)
    svg = svg.replace("<svg", f'<svg role="img" aria-label="{label}"', 1)
    return f"<figure><h3>{label}</h3>{svg}</figure>"


def robot_pictures(summary: Summary) -> str:
    """Velocity and falls on the robot per generation, best and mean candidates."""
    every = [each for method in summary.methods for each in method.candidates]
    if not every:
        return section(
            "On the robot, generation by generation",
            "<p>No learned walk has been evaluated on the robot.</p>",
        )
    kinds = [kind for kind in ("best", "mean") if any(c.candidate == kind for c in every)]
    titles = {
        "best": "best candidate of each generation",
        "mean": "mean of the search distribution",
    }
    pictures = [
        _picture(f"{what}, {titles[kind]}", paint(summary, kind))
        for what, paint in (
            ("Velocity", figures.velocity_picture),
            ("Falls", figures.falls_picture),
        )
        for kind in kinds
    ]
    names = [method.name for method in summary.methods if method.candidates]
    if summary.theta0 is not None:
        names.append(THETA0)
    note = (
        "<p class=note>Filled marks: no walk fell. Hollow marks: some fell, the velocity "
        "is that of the walks that did not. Cross at the bottom: every walk fell. Bars: "
        "95 % intervals, bootstrap for velocities, Wilson for falls (a bootstrap of 0 "
        "falls in 10 would claim certainty). Dashed line and band: theta0.</p>"
    )
    body = legend(names) + f'<div class="pictures">{"".join(pictures)}</div>' + note
    return section("On the robot, generation by generation", body)


def cost_pictures(run: Run, summary: Summary) -> str:
    """Cost per generation in the simulator and on the robot."""
    pictures = []
    names: set[str] = set()
    if any(row.method != THETA0 for row in run.metrics):
        svg = figures.simulator_cost_picture(run.metrics)
        pictures.append(_picture("In each method's own simulator", svg))
        names |= {row.method for row in run.metrics}
    if any(method.candidates for method in summary.methods):
        svg = figures.robot_cost_picture(summary, run.rollouts)
        pictures.append(_picture("On the robot", svg))
        names |= {method.name for method in summary.methods if method.candidates}
    if not pictures:
        body = "<p>Neither metrics.csv nor evaluations.csv has a generation yet.</p>"
        return section("Cost", body)
    note = (
        "<p class=note>Cost is minus the forward velocity, and 1500 cm/s more for a fall; "
        "lower is better. Where falls count, the scale is straight up to 50 and "
        "logarithmic above. Solid: best candidate; dashed: mean of the search "
        "distribution. A cost that keeps sinking in the simulator while it jumps up on "
        "the robot is a search that exploits its simulator.</p>"
    )
    body = legend(ordered(names - {THETA0}))
    body += f'<div class="pictures">{"".join(pictures)}</div>{note}'
    return section("Cost per generation", body)


def prediction_pictures(run: Run) -> str:
    """Prediction error per joint before and after grounding, at every horizon."""
    title = "What grounding did to the simulator"
    latest: dict[str, int] = {}
    for row in run.predictions:
        latest[row.method] = max(latest.get(row.method, 0), row.iteration)
    rows = [
        row
        for row in run.predictions
        if row.iteration == latest[row.method]
        and math.isfinite(row.before_rad)
        and math.isfinite(row.after_rad)
    ]
    if not rows:
        return section(title, "<p>prediction.csv holds no prediction error yet.</p>")
    pictures, lines = [], []
    for place, horizon in enumerate(sorted({row.horizon_s for row in rows})):
        own = [row for row in rows if row.horizon_s == horizon]
        when = f"{horizon:g} s ahead" + (" (one step)" if place == 0 else "")
        pictures.append(_picture(when, figures.prediction_picture(own)))
        lines += [_error_line(when, name, own) for name in ordered(r.method for r in own)]
    note = (
        "<p class=note>Held-out recordings of the robot: its commands are replayed in the "
        "simulator and the joint angles compared. Grey bar: plain simulator; coloured "
        "mark: grounded (last iteration).</p>"
    )
    head = "<tr><th>all joints, rms</th><th>method</th><th class=n>before</th>"
    head += "<th class=n>after</th><th class=n>change</th></tr>"
    body = legend(ordered(row.method for row in rows))
    body += f'<div class="pictures">{"".join(pictures)}</div>{note}'
    body += f"<div class=scroll><table><thead>{head}</thead>"
    body += f"<tbody>{''.join(lines)}</tbody></table></div>"
    return section(title, body)


def _error_line(when: str, method: str, rows: Sequence[Prediction]) -> str:
    own = [row for row in rows if row.method == method]
    before, after = (
        math.degrees(math.sqrt(sum(value**2 for value in column) / len(own)))
        for column in zip(*((r.before_rad, r.after_rad) for r in own), strict=True)
    )
    change = 100.0 * (after / before - 1.0) if before > 0 else math.nan
    return (
        f"<tr><td>{escape(when)}</td><td>{swatch(method)}</td>"
        f"<td class=n>{number(before, 2)}°</td><td class=n>{number(after, 2)}°</td>"
        f"<td class=n>{number(change, 0, sign=True)} %</td></tr>"
    )


def animation(walks: list[Walk]) -> str:
    """The first and the best walk side by side."""
    title = "The first and the best walk"
    if not walks:
        return section(title, "<p>No walk was recorded for the animation.</p>")
    data = json.dumps(pack_walks(walks), allow_nan=False).replace("<", "\\u003c")
    intro = (
        "<p class=note>Drag to turn the view, double-click to reset it. The number is the "
        "distance from the start; lines on the floor are half a metre apart.</p>"
    )
    body = f'{intro}<div id="viewer"></div><noscript>The animation needs javascript.'
    body += f'</noscript><script type="application/json" id="walks">{data}</script>'
    return section(title, body)
