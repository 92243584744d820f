"""The simulation of one joint as a compiled loop: steps outside, simulations inside.

The laws are those of `plant`, written out for numba by `lanes.py`. Blocks of WIDTH
simulations of a run go through the whole log, one after the other. What they consist of
lies in one array, in rows of WIDTH numbers: so the compiler sees that no row runs into
another, and takes as many simulations at once as a register holds.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import partial
from typing import Any

from gatjax.diagnosis import plant
from gatjax.diagnosis.lanes import Code, Named, hoisted, written
from gatjax.diagnosis.laws import Drive, Grid, Servo

WIDTH = 64  # simulations of a block: all of their rows fit the fastest cache
NUMBERS = tuple(name for name in Drive._fields if name != "terms")
WEIGHED = ("rest", "slope", "inertia")
SERIES = ("path", "pull", "stiffness", "supply", "clock", "running")  # of a Grid
TEMPLATE = '''"""Made by gatjax.diagnosis.loop, and made again when it is gone."""

import math

import numpy as np
from numba import njit

f = np.float32
FAST = {"contract", "nsz", "arcp"}


@njit(error_model="numpy", fastmath=FAST)
def sign(x):
    return f(1.0) if x > f(0.0) else (f(-1.0) if x < f(0.0) else f(0.0))


@njit(error_model="numpy", fastmath=FAST)
def floor(x):
    y = np.rint(x)
    return y - f(1.0) if y > x else y


@njit(error_model="numpy", fastmath=FAST)
def exp(x):  # e^x = (e^(x / 64))^64, from e^-40 to e^40
    y = min(max(x, f(-40.0)), f(40.0)) * f(1.0 / 64.0)
    e = f(1.0) + y * f(1.0 / 8.0)
    e = f(1.0) + y * f(1.0 / 7.0) * e
    e = f(1.0) + y * f(1.0 / 6.0) * e
    e = f(1.0) + y * f(1.0 / 5.0) * e
    e = f(1.0) + y * f(1.0 / 4.0) * e
    e = f(1.0) + y * f(1.0 / 3.0) * e
    e = f(1.0) + y * f(1.0 / 2.0) * e
    e = f(1.0) + y * e
    e = e * e
    e = e * e
    e = e * e
    e = e * e
    e = e * e
    return e * e


@njit(nogil=True, cache=<cached>, error_model="numpy", fastmath=FAST)
def simulate(
    numbers, terms, target, reading, <series>, rest, slope, inertia,
    rest_terms, slope_terms, inertia_terms, time, lead, h, readings, angle, heat,
):
    steps, runs = target.shape
    lanes, count = terms.shape
    w = np.zeros(<rows>, np.float32)
    share = np.zeros(count * <width>, np.float32)
    g_rest, g_slope = np.zeros(<width>, np.float32), np.zeros(<width>, np.float32)
    g_inertia, u = np.zeros(<width>, np.float32), np.zeros(<width>, np.float32)
    aim, shown = np.zeros(<width>, np.float32), np.zeros(<width>, np.float32)
    whole, part = np.zeros(<width>, np.int64), np.zeros(<width>, np.float32)
    trace = np.zeros((steps, <width>), np.float32)
    for first in range(0, lanes, <width>):
        n = min(<width>, lanes - first)
        m = -(-n // 16) * 16  # whole registers; what is too much repeats the last one
        for s in range(m):
            lane = min(first + s, lanes - 1)
            for b in range(count):
                share[b * <width> + s] = terms[lane, b]
            <loaded>
            <once>
            <kept>
            late = p_delay / h + f(0.5)  # torques act around a step, cells begin it
            whole[s] = int(math.floor(late))
            part[s] = late - f(math.floor(late))
        for r in range(runs):
            for s in range(m):
                k, x_clock, told = 0, clock[0, r], target[0, r]
                <aim>
                <begun>
            for k in range(steps):
                for s in range(m):
                    i = min(max(k - whole[s], 0), steps - 1)
                    newer, older = target[i, r], target[max(i - 1, 0), r]
                    u[s] = newer * (f(1.0) - part[s]) + older * part[s]
                for s in range(m):
                    g_rest[s] = rest[k, r]
                    g_slope[s] = slope[k, r]
                    g_inertia[s] = inertia[k, r]
                for b in range(count):
                    more_rest, more_slope = rest_terms[k, r, b], slope_terms[k, r, b]
                    more_inertia = inertia_terms[k, r, b]
                    for s in range(m):
                        x = share[b * <width> + s]
                        g_rest[s] += more_rest * x
                        g_slope[s] += more_slope * x
                        g_inertia[s] += more_inertia * x
                <now>
                for s in range(m if <drawn> else 0):
                    <aim>
                for s in range(m):
                    x_rest, x_slope = g_rest[s], g_slope[s]
                    x_inertia = max(g_inertia[s], f(1e-6))
                    x_u, x_aim = u[s], aim[s]
                    <step>
                    shown[s] = <link>
                    trace[k, s] = <seen>
                for s in range(n if angle.shape[0] else 0):
                    angle[k, r, first + s] = shown[s]
            for s in range(n):
                heat[r, first + s] = <heat>
            for row in range(time.shape[1]):
                x_time = time[r, row]
                for s in range(n):
                    <place>
                    place = min(max(<at>, f(0.0)), f(steps - 2))
                    i = min(max(int(place), 0), steps - 2)  # whatever the numbers are
                    x_q = trace[i, s] + (place - f(i)) * (trace[i + 1, s] - trace[i, s])
                    <encoded>
                    readings[r, row, first + s] = <read>
'''


class _Rows:
    """The rows of the array that a block of simulations consists of."""

    def __init__(self, names: Sequence[str]) -> None:
        self.names = list(names)

    def at(self, name: str) -> str:
        """Where one simulation's number lies."""
        return f"w[{self.names.index(name) * WIDTH} + s]"

    def loads(self, *codes: Code) -> list[str]:
        """Lines that make local names of all that some code uses."""
        used = {name for code in codes for line in code.lines for name in line.uses}
        used |= {name for code in codes for name in code.outputs}
        return [f"{n} = {self.at(n)}" for n in self.names if n in used]

    def stores(self, names: Sequence[str], values: Sequence[str]) -> list[str]:
        """Lines that keep values under names."""
        pairs = zip(names, values, strict=True)
        return [f"{self.at(name)} = {value}" for name, value in pairs]


def source(geared: bool, drawn: bool, h: float) -> str:
    """The module that simulates joints with a rigid or an elastic gear.

    Args:
        geared: whether motor and link are two inertias.
        drawn: whether the joint is drawn to its measured motion.
        h: step, s.
    """
    p = Drive(*(Named(f"p_{name}") for name in NUMBERS), terms=Named(""))
    plain = [f"p_{name}" for name in NUMBERS]
    kind: Any = plant.Geared if geared else plant.Rigid
    servo = Servo(*(Named(f"s_{name}") for name in Servo._fields))
    state = kind(*(Named(f"s_{name}") for name in kind._fields[:-1]), servo)
    kept = [leaf.name for leaf in (*state[:-1], *servo)]
    once, going = hoisted(_step(p, state, drawn, h), plain)
    used = {name for line in going.lines for name in line.uses}
    fixed = [line.name for line in once if line.name in used and not line.truth]
    begun = written(partial(plant.begun, kind), (p, Named("told"), Named("x_aim")), "b")
    later = written(partial(plant.later, h=h), (p, Named("x_clock")), "l")
    right = written(plant.decoded, (p, Named("x_read")), "d")
    given = p, Named("x_time"), Named("lead")
    place = written(partial(plant.place, h=h), given, "a")
    read = written(plant.encoded, (p, Named("x_q")), "e")
    rows = _Rows([*plain, *fixed, *kept])
    *new, link, seen = going.outputs
    lines = {
        "loaded": [f"{name} = numbers[{n}, lane]" for n, name in enumerate(plain)],
        "once": [line.code.replace("exp(", "math.exp(") for line in once],
        "kept": rows.stores([*plain, *fixed], [*plain, *fixed]),
        "aim": [
            *rows.loads(later, right), *later.texts,
            f"place = min(max(f(k) + {later.outputs[0]}, f(0.0)), f(steps - 2))",
            "i = min(max(int(place), 0), steps - 2)",
            "rising = reading[i + 1, r] - reading[i, r]",
            "x_read = reading[i, r] + (place - f(i)) * rising",
            *right.texts, f"aim[s] = {right.outputs[0]}",
        ],
        "begun": [
            *rows.loads(begun), "x_aim = aim[s]", *begun.texts,
            *rows.stores(kept, begun.outputs),
        ],
        "now": [f"x_{name} = {name}[k, r]" for name in SERIES],
        "step": [*rows.loads(going), *going.texts, *rows.stores(kept, new)],
        "place": [*rows.loads(place, read), *place.texts], "encoded": read.texts,
    }  # fmt: skip
    words = {
        "series": ", ".join(SERIES), "rows": f"{len(rows.names) * WIDTH}",
        "width": f"{WIDTH}", "drawn": f"{drawn}", "link": link, "seen": seen,
        "heat": rows.at("s_heat"), "at": place.outputs[0], "read": read.outputs[0],
    }  # fmt: skip
    return filled(TEMPLATE, lines, words)


def _step(p: Drive, state: Any, drawn: bool, h: float) -> Code:
    """A step's code; what it leaves is the new state, the link's angle and the seen."""
    ranks = {name: 2 if name in WEIGHED else 1 for name in Grid._fields}
    g = Grid(**{name: Named(f"x_{name}", rank) for name, rank in ranks.items()})

    def step(p: Drive, g: Grid, u: Any, aim: Any, s: Any) -> tuple:
        new = plant.advanced(p, g, u, aim if drawn else s.seen(p), s, h)
        return new, new.q, new.seen(p)

    return written(step, (p, g, Named("x_u"), Named("x_aim"), state), "t")


def filled(
    template: str, lines: Mapping[str, Sequence[str]], words: Mapping[str, str]
) -> str:
    """A template with lines in place of <name> on a line of its own, and words."""
    out = []
    for row in template.splitlines():
        name = row.strip()[1:-1]
        if row.strip() == f"<{name}>" and name in lines:
            indent = row[: len(row) - len(row.lstrip())]
            out += [indent + line for line in lines[name]]
        else:
            out.append(row)
    text = "\n".join(out)
    for name, word in words.items():
        text = text.replace(f"<{name}>", word)
    return text
