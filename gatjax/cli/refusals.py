"""What tyro says in a box of many lines when it refuses an option, in one line."""

from __future__ import annotations

import difflib
import io
import re
from collections.abc import Iterator
from contextlib import contextmanager, redirect_stderr

COLOUR = r"\x1b\[[0-9;]*m"
EDGES = r"^[\u2502 ] | *\u2502$"  # of a row in a frame; there may be no lines
RULE = r"\n *\u2570?[\u2500-]{9,}\u256f? *(?=\n)"  # between the parts in it
KINDS = {
    r"invalid literal for int\(\) with base 10: ('.*?')": "a whole number",
    r"could not convert string to float: ('.*?')": "a number",
}


@contextmanager
def short(verb: str) -> Iterator[None]:
    """Raise what tyro prints and exits with in the block as an error of one line.

    Raises:
        ValueError: what is wrong, the option that may be meant, whose help has more.
    """
    said = io.StringIO()
    try:
        with redirect_stderr(said):
            yield
    except SystemExit as stop:
        if not stop.code:
            raise
        raise ValueError(line(said.getvalue(), verb)) from None


def line(box: str, verb: str) -> str:
    """Say a refusal of tyro in one line.

    Args:
        box: what it printed, in the frame that it draws.
        verb: whose options are refused.
    """
    rows = [re.sub(EDGES, "", row) for row in re.sub(COLOUR, "", box).splitlines()]
    parts = re.split(RULE, "\n".join(["", *rows[1:], ""]))
    first, *more = [part.strip("\n") for part in parts if part.strip()] or [""]
    unknown = re.search(r"(?m)^(?:Unrecognized options:| ) +([^\s,]+)", first)
    if unknown and first.startswith("Unrecognized"):
        near = meant(unknown[1], more[0], verb)
        cause = (
            f"{verb} has no option {unknown[1]}{near and f' (did you mean {near}?)'}"
        )
    else:
        cause = _cause(first, verb)
    return f"{cause}; see gatjax {verb} --help"


def meant(unknown: str, listed: str, verb: str) -> str:
    """The option of a verb that may be meant; empty if none is like it."""
    flags: list[str] = []
    for entry in re.split(r"\n(?= {4}--)", listed):
        if "in gatjax " not in entry or f"in gatjax {verb} --help" in entry:
            flags += re.findall(r"--[\w-]+", entry.strip().splitlines()[0])
    return next(iter(difflib.get_close_matches(unknown, flags, 1)), "")


def _cause(first: str, verb: str) -> str:
    """What is refused, from the first part of a box."""
    lacking = re.findall(r"(?m)^ {4}(\S+)", first)
    if first.startswith("Missing from") and lacking:
        return f"{verb} needs {', '.join(lacking)}"
    told = " ".join(first.split()).rstrip(".")
    flag = told.removeprefix("Error parsing ").partition(": ")[0]
    for pattern, kind in KINDS.items():
        if found := re.search(pattern, told):
            return f"{flag} takes {kind}, not {found[1]}"
    choice = re.search(r"^invalid choice (.*) for argument '(.*)'. .* \((.*)\)$", told)
    if choice:
        known = choice[3].replace("'", "")
        return f"{choice[2]} knows no {choice[1]}; choose from {known}"
    return told
