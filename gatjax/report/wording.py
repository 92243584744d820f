"""Numbers as people read them: a missing or infinite one is a dash, never nan."""

from __future__ import annotations

import html
import math

from gatjax.report.intervals import Interval

DASH = "\N{EN DASH}"
MINUS = "\N{MINUS SIGN}"


def escape(text: object) -> str:
    """Make any text safe inside html."""
    return html.escape(str(text))


def number(value: float, digits: int = 1, sign: bool = False) -> str:
    """Write a number with a true minus sign; a dash if it is not finite."""
    if not math.isfinite(value):
        return DASH
    text = f"{value:+.{digits}f}" if sign else f"{value:.{digits}f}"
    if float(text) == 0.0:
        text = text.lstrip("+-")
    return text.replace("-", MINUS)


def significant(value: float, digits: int = 3) -> str:
    """Write a number with so many significant digits."""
    if not math.isfinite(value):
        return DASH
    return f"{value:.{digits}g}".replace("-", MINUS)


def span(interval: Interval, digits: int = 1, sign: bool = False) -> str:
    """Write the ends of an interval, `18.0 to 18.4`."""
    if not interval.known:
        return "too few walks for an interval"
    low = number(interval.low, digits, sign)
    return f"{low} to {number(interval.high, digits, sign)}"


def percent(share: float) -> str:
    """Write a share as whole per cent; small but not zero is said so."""
    if 0.0 < share < 0.005:
        return "< 1 %"
    return f"{number(100.0 * share, 0)} %"


def duration(seconds: float) -> str:
    """Write a time as seconds, minutes or hours."""
    if not math.isfinite(seconds):
        return DASH
    if seconds < 120:
        return f"{seconds:.1f} s"
    if seconds < 7200:
        return f"{seconds / 60:.1f} min"
    return f"{seconds / 3600:.1f} h"
