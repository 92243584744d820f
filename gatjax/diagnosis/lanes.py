"""Functions of single numbers, written in JAX, as straight-line code for numba.

XLA makes some 26 kernels of a step of a joint and calls each of them at every step. As
one loop over simulations the same arithmetic vectorises, and costs nothing to begin.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Iterable, Sequence
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax.extend.core import Literal

SAME = {"broadcast_in_dim", "copy", "reshape", "squeeze", "stop_gradient"}
TEXTS = {
    "abs": "abs({0})", "add": "{0} + {1}", "and": "{0} & {1}", "div": "{0} / {1}",
    "eq": "{0} == {1}", "exp": "exp({0})", "floor": "floor({0})", "ge": "{0} >= {1}",
    "gt": "{0} > {1}", "le": "{0} <= {1}", "lt": "{0} < {1}",
    "max": "{0} if {0} > {1} else {1}", "min": "{0} if {0} < {1} else {1}",
    "mul": "{0} * {1}", "ne": "{0} != {1}", "neg": "-{0}", "not": "not {0}",
    "or": "{0} | {1}", "round": "np.rint({0})", "select_n": "{2} if {0} else {1}",
    "sign": "sign({0})", "sqrt": "np.sqrt({0})", "square": "{0} * {0}",
    "sub": "{0} - {1}",
}  # fmt: skip
CASTS = {"float32": "f(1.0) if {0} else f(0.0)", "bool": "{0} != f(0.0)"}


class Named(NamedTuple):
    """An argument: a number with a name, seen as an array of so many dimensions."""

    name: str
    rank: int = 2


class Line(NamedTuple):
    """name = text, with the names that the text uses."""

    name: str
    text: str
    uses: tuple[str, ...]
    truth: bool  # whether it is true or false, and no number

    @property
    def code(self) -> str:
        """The line."""
        return f"{self.name} = {self.text}"


class Code(NamedTuple):
    """Lines, and the names or numbers that they leave in the function's outputs."""

    lines: list[Line]
    outputs: list[str]

    @property
    def texts(self) -> list[str]:
        """The lines as text."""
        return [line.code for line in self.lines]


def written(function: Callable[..., Any], arguments: Any, mark: str) -> Code:
    """The code of a function.

    Args:
        function: of elementwise operations, for arrays of float32.
        arguments: tuple of trees of `Named`.
        mark: that its own names begin with.

    Raises:
        KeyError: an operation that is not in TEXTS.
    """
    leaves, tree = jax.tree.flatten(arguments, is_leaf=_is_named)
    arrays = [jax.ShapeDtypeStruct((1,) * leaf.rank, jnp.float32) for leaf in leaves]
    with jax.enable_x64(False):
        traced = jax.make_jaxpr(function)(*jax.tree.unflatten(tree, arrays))
    lines: list[Line] = []
    names = [leaf.name for leaf in leaves]
    outputs = _followed(traced.jaxpr, traced.consts, names, lines, mark)
    return Code(_needed(lines, outputs), outputs)


def _is_named(leaf: Any) -> bool:
    return isinstance(leaf, Named)


def _followed(
    jaxpr: Any,
    consts: Sequence[Any],
    names: Sequence[str],
    lines: list[Line],
    mark: str,
) -> list[str]:
    """Append the lines of a traced function of some names; return its outputs."""
    known = dict(zip(jaxpr.invars, names, strict=True))
    known |= {v: _number(c) for v, c in zip(jaxpr.constvars, consts, strict=True)}

    def named(v: Any) -> str:
        return _number(v.val) if isinstance(v, Literal) else known[v]

    for equation in jaxpr.eqns:
        given = [named(v) for v in equation.invars]
        inner = equation.params.get("jaxpr")
        if inner is not None:
            made = _followed(inner.jaxpr, inner.consts, given, lines, mark)
            known |= dict(zip(equation.outvars, made, strict=True))
            continue
        (out,) = equation.outvars
        name, text = equation.primitive.name, None
        if name == "convert_element_type":
            before, after = str(equation.invars[0].aval.dtype), str(out.aval.dtype)
            text = None if before == after else CASTS[after]
        elif name not in SAME:
            text = TEXTS[name]
        if text is None:
            known[out] = given[0]
            continue
        known[out] = f"{mark}{len(lines)}"
        uses = tuple(each for each in given if each.isidentifier())
        truth = str(out.aval.dtype) == "bool"
        lines.append(Line(known[out], text.format(*given), uses, truth))
    return [named(v) for v in jaxpr.outvars]


def _number(value: Any) -> str:
    number = float(np.reshape(value, ()))
    return f"f({number!r})" if math.isfinite(number) else f'f(float("{number}"))'


def _needed(lines: Sequence[Line], outputs: Iterable[str]) -> list[Line]:
    """Lines that the outputs depend on."""
    wanted, kept = set(outputs), []
    for line in reversed(lines):
        if line.name in wanted:
            kept.append(line)
            wanted |= set(line.uses)
    return kept[::-1]


def hoisted(code: Code, fixed: Collection[str]) -> tuple[list[Line], Code]:
    """Lines that only use fixed names, and the code that is left.

    What is left multiplies where it would divide by something fixed, and has what is
    true or false once more, so that only numbers have to be kept.
    """
    still, before, after = set(fixed), [], []
    for line in code.lines:
        if still.issuperset(line.uses):
            before.append(line)
            still.add(line.name)
            continue
        over = line.text.rpartition(" / ")[2]
        if over in still:
            inverse = Line(f"over_{over}", f"f(1.0) / {over}", (over,), False)
            before += [] if inverse.name in still else [inverse]
            still.add(inverse.name)
            text = line.text.removesuffix(f" / {over}") + f" * {inverse.name}"
            uses = (*(each for each in line.uses if each != over), inverse.name)
            line = line._replace(text=text, uses=uses)
        after.append(line)
    left = [line for line in before if line.truth] + after
    return before, Code(_needed(left, code.outputs), code.outputs)
