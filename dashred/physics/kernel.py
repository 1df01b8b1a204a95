"""Pointwise functions compiled to machine code, for batches in which each row has its own terms.

A few hundred points are so little that array operations cost what calling them costs. Here one
call evaluates everything that is pointwise in a stage; a term costs only the rows that carry it.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from typing import Any

import numba
import numpy as np
from numpy.typing import NDArray

from dashred.physics.algebra import Call, Expr, Name, Number, Power, Product, Sum, names

Array = NDArray[np.float64]
Kernel = Callable[[Array, Array, float, Array, Array], None]
# Told by its type alone, a kernel is called and not compiled again into what calls it.
REAL = numba.float64
KERNEL = numba.void(REAL[:, :, ::1], REAL[:, ::1], REAL, REAL[:, ::1], REAL[:, :, ::1])

# Sums may be reordered and fused, but values that are not finite stay what they are.
MATHEMATICS = {"contract", "reassoc", "arcp", "nsz"}


@dataclass(frozen=True)
class Body:
    """A pointwise function that is added to one channel.

    Attributes:
        channel: which.
        expression: without spatial operators.
        weight: column of the weights that multiplies it; None for the system's own.
    """

    channel: int
    expression: Expr
    weight: int | None


def compile_kernel(
    bodies: Sequence[Body], inputs: Sequence[str], coordinates: Sequence[str]
) -> Kernel:
    """Return ``kernel(inputs, coordinates, t, weights, channels)``, which fills the channels.

    ``channels[c] = Σ_own body + Σ_terms weights[row] body``, over inputs
    ``(input, row, point)``, coordinates ``(coordinate, point)``, weights ``(row, weight)`` and
    channels ``(channel, row, point)``. The code is written from checked expression trees alone;
    no text of the user's gets into it. It is to be called from compiled code.

    Args:
        bodies: the functions.
        inputs: names of the inputs, in order.
        coordinates: names of the coordinates, in order; ``t`` is known too.
    """
    known = {name: f"x[{i}, r, i]" for i, name in enumerate(inputs)}
    known |= {name: f"c[{i}, i]" for i, name in enumerate(coordinates)}
    known["t"] = "t"
    own = [body for body in bodies if body.weight is None]
    lines = ["def kernel(x, c, t, w, out):", "    for r in range(out.shape[1]):"]
    lines += ["        out[:, r] = 0.0"]
    lines += _loop(own, known, indent=8)
    terms: dict[int, list[Body]] = {}
    for body in bodies:
        if body.weight is not None:
            terms.setdefault(body.weight, []).append(body)
    for weight, group in terms.items():
        lines += [f"        a = w[r, {weight}]", "        if a != 0.0:"]
        lines += _loop(group, known, indent=12)
    return _compile("\n".join(lines))


@cache
def _compile(source: str) -> Kernel:
    """Compile a kernel once, on whatever grids it is used."""
    scope: dict[str, Any] = {"math": math}
    exec(source, scope)
    compiled: Kernel = numba.cfunc(KERNEL, fastmath=MATHEMATICS, error_model="numpy")(
        scope["kernel"]
    )
    return compiled


def _loop(bodies: Sequence[Body], known: Mapping[str, str], indent: int) -> list[str]:
    if not bodies:
        return [" " * indent + "pass"]
    writer = _Writer(known)
    found = [(body, writer.write(body.expression)) for body in bodies]
    inner = [*writer.lines]
    for body, value in found:
        factor = "" if body.weight is None else "a * "
        inner.append(f"out[{body.channel}, r, i] += {factor}{value}")
    head = " " * indent + "for i in range(out.shape[2]):"
    return [head, *(" " * (indent + 4) + line for line in inner)]


class _Writer:
    """Writes expressions as statements, each common part once."""

    def __init__(self, known: Mapping[str, str]) -> None:
        self.known = known
        self.lines: list[str] = []
        self.seen: dict[Expr, str] = {}

    def write(self, expr: Expr) -> str:
        """Return the code of the expression's value, its parts written before it."""
        if isinstance(expr, Number):
            return f"({expr.value!r})"
        if expr not in self.seen:
            code = self._code(expr)
            name = f"v{len(self.seen)}"
            self.lines.append(f"{name} = {code}")
            self.seen[expr] = name
        return self.seen[expr]

    def _code(self, expr: Expr) -> str:
        match expr:
            case Name(id):
                return self.known[id]
            case Sum(terms):
                return " + ".join(map(self.write, terms))
            case Product(factors):
                return " * ".join(map(self.write, factors))
            case Power(base, Number(2.0)):
                value = self.write(base)
                return f"{value} * {value}"
            case Power(base, Number(3.0)):
                value = self.write(base)
                return f"{value} * {value} * {value}"
            case Power(base, Number(-1.0)):
                return f"1.0 / {self.write(base)}"
            case Power(base, exponent):
                return f"{self.write(base)} ** {self.write(exponent)}"
            case Call(function, operand) if function in CODE:
                return CODE[function].format(self.write(operand))
        raise TypeError(f"{expr!r} is not pointwise")


def read_by(bodies: Sequence[Body]) -> frozenset[str]:
    """Return the names that some bodies read."""
    return frozenset().union(*(names(body.expression) for body in bodies))


CODE = {
    "sin": "math.sin({0})",
    "cos": "math.cos({0})",
    "tan": "math.tan({0})",
    "exp": "math.exp({0})",
    "log": "math.log({0})",
    "sqrt": "math.sqrt({0})",
    "tanh": "math.tanh({0})",
    "sech": "1.0 / math.cosh({0})",
    "abs": "abs({0})",
    "sign": "(1.0 if {0} > 0.0 else (-1.0 if {0} < 0.0 else 0.0))",
    "step": "(1.0 if {0} > 0.0 else 0.0)",
}
