"""The parts of the page that hold pictures, with their legends and captions."""

from __future__ import annotations

import math
from collections.abc import Sequence

from gatjax.report import figures
from gatjax.report.read import THETA0, Prediction, Run
from gatjax.report.sections import section, swatch
from gatjax.report.tables import Summary, ordered
from gatjax.report.wording import escape, number


def legend(methods: Sequence[str]) -> str:
    """The colours of a picture, in html."""
    names = "".join(f"<span>{swatch(name)}</span>" for name in methods)
    return f'<div class="legend">{names}</div>'


def _picture(title: str, svg: str) -> str:
    label = escape(title)
    svg = svg.replace("<svg", f'<svg role="img" aria-label="{label}"', 1)
    return f"<figure><h3>{label}</h3>{svg}</figure>"


def robot_pictures(summary: Summary) -> str:
    """Velocity and falls on the robot by generation, for each kind of candidate."""
    every = [each for method in summary.methods for each in method.candidates]
    if not every:
        return section(
            "On the robot, generation by generation",
            "<p>No learned walk has been evaluated on the robot.</p>",
        )
    titles = {
        "best": "best candidate of each generation",
        "mean": "mean of the search distribution",
        "rechecked": "the best of each generation in more rollouts",
    }
    kinds = [kind for kind in titles if any(c.candidate == kind for c in every)]
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
        "<p class=note>Filled marks: no walk fell. Hollow marks: some fell, the "
        "velocity is that of the walks that did not. Cross at the bottom: every walk "
        "fell. Bars: 95 % intervals, Student t for velocities (pale where they "
        "leave the picture: few walks stood), Wilson for falls. Dashed line and "
        "band: theta0. Confirmation walks are not in these pictures.</p>"
    )
    body = legend(names) + f'<div class="pictures">{"".join(pictures)}</div>' + note
    return section("On the robot, generation by generation", body)


def cost_pictures(run: Run, summary: Summary) -> str:
    """Cost per generation in the simulator and on the robot."""
    costs = {
        "In each method's own simulator": figures.simulator_costs(run.metrics),
        "On the robot": figures.robot_costs(summary, run.rollouts),
    }
    pictures = [
        _picture(title, figures.cost_picture(rows))
        for title, rows in costs.items()
        if rows
    ]
    names = {row.method for rows in costs.values() for row, _ in rows}
    if not pictures:
        body = "<p>Neither metrics.csv nor evaluations.csv has a generation yet.</p>"
        return section("Cost", body)
    note = (
        "<p class=note>Cost is minus the forward velocity, and 1500 cm/s more for a "
        "fall; lower is better. Where falls count, the scale is straight up to 50 and "
        "logarithmic above. Solid: best candidate; dashed: mean of the search "
        "distribution; dotted: the best in more rollouts. A cost that keeps sinking "
        "in the simulator while it jumps up on the robot is a search that exploits its "
        "simulator.</p>"
    )
    body = legend(ordered(names))
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
        lines += [
            _error_line(when, name, own) for name in ordered(r.method for r in own)
        ]
    note = (
        "<p class=note>Held-out recordings of the robot: its commands are replayed in "
        "the simulator and the joint angles compared. Grey bar: plain simulator; "
        "coloured mark: grounded (last iteration).</p>"
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
