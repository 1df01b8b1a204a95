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

from dashred.physics.backends.codegen import CodeWriter, define
from dashred.physics.backends.input_signals import NO_INPUTS, InputSignals
from dashred.physics.expressions.algebra import Expr, names

Array = NDArray[np.float64]
Kernel = Callable[[Array, Array, float, Array, Array], None]
# Told by its type alone, a kernel is called and not compiled again into what calls it.
REAL = numba.float64
KERNEL = numba.void(REAL[:, :, ::1], REAL[:, ::1], REAL, REAL[:, ::1], REAL[:, :, ::1])

# Of a term that may be there in a window: outside of it a, inside a + b.
WINDOWED_COEFFICIENT = "a + b * window(x, c, t, w, r, i) if b != 0.0 else a"

# Sums may be reordered and fused, but values that are not finite stay what they are.
FAST_MATH = {"contract", "reassoc", "arcp", "nsz"}


@dataclass(frozen=True)
class ChannelTerm:
    """A pointwise function that is added to one channel.

    Attributes:
        channel: which.
        expression: without spatial operators.
        weight: column of the weights that multiplies it; None for the system's own.
        inside: column that multiplies it within the row's window; None where there are no windows.
    """

    channel: int
    expression: Expr
    weight: int | None
    inside: int | None = None


@dataclass(frozen=True)
class WindowFactor:
    """A factor of the window χ that some rows have.

    Attributes:
        flag: column of the weights that is not 0 where a row has it.
        expression: over inputs, coordinates, ``t`` and unknowns of its own.
        unknowns: column of each unknown's value, by name.
    """

    flag: int
    expression: Expr
    unknowns: Mapping[str, int]


def compile_kernel(
    bodies: Sequence[ChannelTerm],
    inputs: Sequence[str],
    coordinates: Sequence[str],
    factors: Sequence[WindowFactor] = (),
    input_signals: InputSignals = NO_INPUTS,
) -> Kernel:
    """Return ``kernel(inputs, coordinates, t, weights, channels)``, which fills the channels.

    ``channels[c] = Σ_own body + Σ_terms (weight + inside·χ) body`` of each row, with χ the
    product of its factors, over inputs ``(input, row, point)``, coordinates
    ``(coordinate, point)``, weights ``(row, weight)`` and channels ``(channel, row, point)``. The
    code is written from checked expression trees alone; no text of the user's gets into it. It is
    to be called from compiled code.

    Args:
        bodies: the functions.
        inputs: names of the inputs, in order.
        coordinates: names of the coordinates, in order; ``t`` is known too.
        factors: of the rows' windows.
        input_signals: the system's inputs in time.
    """
    known = {name: f"x[{i}, r, i]" for i, name in enumerate(inputs)}
    known |= {name: f"c[{i}, i]" for i, name in enumerate(coordinates)}
    known["t"] = "t"
    rows = list(enumerate(input_signals.values, 1))
    known |= {name: f"m{row}" for row, name in rows}
    now = [f"    m{row} = at(t, {row})" for row, _ in rows]
    own = [body for body in bodies if body.weight is None and body.inside is None]
    lines = ["def kernel(x, c, t, w, out):", *now, "    for r in range(out.shape[1]):"]
    lines += ["        out[:, r] = 0.0"]
    lines += _loop(own, known, 8)
    terms: dict[tuple[int | None, int | None], list[ChannelTerm]] = {}
    for body in bodies:
        if body not in own:
            terms.setdefault((body.weight, body.inside), []).append(body)
    for (weight, inside), group in terms.items():
        a, b = (f"w[r, {column}]" if column is not None else "0.0" for column in (weight, inside))
        lines += [f"        a, b = {a}, {b}", "        if a != 0.0 or b != 0.0:"]
        lines += _loop(group, known, 12, "a" if inside is None else WINDOWED_COEFFICIENT)
    return _compile("\n".join(lines), _window(factors, known, now), input_signals)


def _window(factors: Sequence[WindowFactor], known: Mapping[str, str], now: Sequence[str]) -> str:
    """Return the code of χ at one point of one row."""
    lines = ["def window(x, c, t, w, r, i):", *now, "    value = 1.0"]
    for factor in factors:
        columns = {name: f"w[r, {column}]" for name, column in factor.unknowns.items()}
        writer = CodeWriter({**known, **columns})
        value = writer.write(factor.expression)
        inner = [*writer.lines, f"value *= {value}"]
        lines += [f"    if w[r, {factor.flag}] != 0.0:", *(f"        {line}" for line in inner)]
    return "\n".join([*lines, "    return value"])


@cache
def _compile(source: str, window: str, input_signals: InputSignals) -> Kernel:
    """Compile a kernel once, on whatever grids it is used."""
    table = input_signals.table

    @numba.njit(error_model="numpy")
    def at(t: float, row: int) -> float:
        value: float = np.interp(t, table[0], table[row])
        return value

    scope: dict[str, Any] = {"math": math, "at": at}
    define(f"{window}\n{source}", scope)
    scope["window"] = numba.njit(fastmath=FAST_MATH, error_model="numpy")(scope["window"])
    compiled: Kernel = numba.cfunc(KERNEL, fastmath=FAST_MATH, error_model="numpy")(scope["kernel"])
    return compiled


def _loop(
    bodies: Sequence[ChannelTerm],
    known: Mapping[str, str],
    indent: int,
    coefficient: str | None = None,
) -> list[str]:
    if not bodies:
        return [" " * indent + "pass"]
    writer = CodeWriter(known)
    found = [(body, writer.write(body.expression)) for body in bodies]
    inner = [*writer.lines, *([f"f = {coefficient}"] if coefficient else [])]
    factor = "f * " if coefficient else ""
    inner += [f"out[{body.channel}, r, i] += {factor}{value}" for body, value in found]
    head = " " * indent + "for i in range(out.shape[2]):"
    return [head, *(" " * (indent + 4) + line for line in inner)]


def names_read(bodies: Sequence[ChannelTerm]) -> frozenset[str]:
    """Return the names that some bodies read."""
    return frozenset().union(*(names(body.expression) for body in bodies))
