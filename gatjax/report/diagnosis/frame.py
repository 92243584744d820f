"""Frames of the page: pictures with their keys, tables, bars in their cells."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence

from gatjax.report.wording import escape


def picture(title: str, svg: str, caption: str = "") -> str:
    """One picture with its title and, below it, a line on how to read it."""
    label = escape(title)
    svg = svg.replace("<svg", f'<svg role="img" aria-label="{label}"', 1)
    below = f"<figcaption>{escape(caption)}</figcaption>" if caption else ""
    return f"<figure><h3>{label}</h3>{svg}{below}</figure>"


def gallery(pictures: Iterable[str]) -> str:
    """Pictures beside each other, as many as the window is wide."""
    return f'<div class="pictures">{"".join(pictures)}</div>'


def key(*entries: tuple[str, str]) -> str:
    """What the colours of a picture mean: css variable, words."""
    items = "".join(
        f'<span class="method"><span class="swatch" style="--mark: var(--{colour})">'
        f"</span>{escape(words)}</span>"
        for colour, words in entries
    )
    return f'<div class="legend">{items}</div>'


def bar(share: float, colour: str) -> str:
    """A share of 1 as a bar in a table cell."""
    width = min(max(share, 0.0), 1.0) if math.isfinite(share) else 0.0
    track = f"--mark: var(--{colour}); background: var(--grid)"
    place = f"left: 0; width: {100.0 * width:.1f}%"
    return f'<div class="bar" style="{track}"><i style="{place}"></i></div>'


def signed_bar(share: float, colour: str) -> str:
    """A share between -1 and 1 as a bar from the middle of a table cell."""
    half = 50.0 * min(abs(share), 1.0) if math.isfinite(share) else 0.0
    place = f"left: {50.0 if share >= 0.0 else 50.0 - half:.1f}%; width: {half:.1f}%"
    track = f"--mark: var(--{colour})"
    return f'<div class="bar" style="{track}"><i style="{place}"></i></div>'


def table(head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """A table of html cells."""
    top = "".join(f"<th>{escape(cell)}</th>" for cell in head)
    lines = "".join(
        f"<tr>{''.join(f'<td>{cell}</td>' for cell in row)}</tr>" for row in rows
    )
    return (
        f"<div class=scroll><table><thead><tr>{top}</tr></thead>"
        f"<tbody>{lines}</tbody></table></div>"
    )


def folded(head: Sequence[str], rows: Sequence[Sequence[str]], most: int) -> str:
    """A table whose rows after the first `most` are folded away."""
    body = table(head, rows[:most])
    if len(rows) > most:
        body += f"<details><summary>{len(rows) - most} more</summary>"
        body += f"{table(head, rows[most:])}</details>"
    return body
