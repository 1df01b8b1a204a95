"""Pointwise functions compiled by Numba, for batches in which each row has its own terms.

On a few hundred points, the overhead of an array operation exceeds its cost. A compiled kernel
evaluates all pointwise functions of a stage in one call, and evaluates a term only on the rows
that use it.
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
from dashred.physics.backends.table_reader import table_reader
from dashred.physics.expressions.algebra import Expr, names

Array = NDArray[np.float64]
Kernel = Callable[[Array, Array, float, Array, Array], None]
# With an explicit function type, Numba calls a kernel instead of recompiling its callers for it.
REAL = numba.float64
KERNEL = numba.void(REAL[:, :, ::1], REAL[:, ::1], REAL, REAL[:, ::1], REAL[:, :, ::1])

# Coefficient of a term with a window χ: a + b χ.
WINDOWED_COEFFICIENT = "a + b * window(x, c, t, w, r, i) if b != 0.0 else a"

# Sums may be reordered and fused; NaN and infinity keep their meaning.
FAST_MATH = {"contract", "reassoc", "arcp", "nsz"}


@dataclass(frozen=True)
class ChannelTerm:
    """A pointwise function that is added to one channel.

    Attributes:
        channel: index of the channel.
        expression: the function, without spatial operators.
        weight: column of its coefficient in the weights; None for a term of the system.
        window_weight: column of its coefficient times the row's window; None without windows.
    """

    channel: int
    expression: Expr
    weight: int | None
    window_weight: int | None = None


@dataclass(frozen=True)
class WindowFactor:
    """A factor of the window χ of some rows.

    Attributes:
        flag: column of the weights that is nonzero if the row's window has this factor.
        expression: function of inputs, coordinates, ``t`` and the factor's unknowns.
        unknowns: column of each unknown's value, by name.
    """

    flag: int
    expression: Expr
    unknowns: Mapping[str, int]


def compile_kernel(
    channel_terms: Sequence[ChannelTerm],
    inputs: Sequence[str],
    coordinates: Sequence[str],
    factors: Sequence[WindowFactor] = (),
    input_signals: InputSignals = NO_INPUTS,
) -> Kernel:
    """Return ``kernel(inputs, coordinates, t, weights, channels)``, which fills the channels.

    For each row, ``channels[c] = Σ_system f + Σ_terms (weight + window_weight·χ) f``, where χ is
    the product of the row's window factors. The arrays are inputs ``(input, row, point)``,
    coordinates ``(coordinate, point)``, weights ``(row, weight)`` and channels
    ``(channel, row, point)``. Without coordinates there is one point. The kernel can be called
    from compiled code only.

    Args:
        channel_terms: the pointwise functions.
        inputs: names of the inputs, in order.
        coordinates: names of the coordinates, in order; ``t`` is known too.
        factors: the factors of the rows' windows.
        input_signals: the system's inputs.
    """
    known = {name: f"x[{i}, r, i]" for i, name in enumerate(inputs)}
    known |= {name: f"c[{i}, i]" for i, name in enumerate(coordinates)}
    known["t"] = "t"
    rows = list(enumerate(input_signals.values, 1))
    known |= {name: f"m{row}" for row, name in rows}
    now = [f"    m{row} = at(t, {row})" for row, _ in rows]
    own = [f for f in channel_terms if f.weight is None and f.window_weight is None]
    lines = ["def kernel(x, c, t, w, out):", *now, "    for r in range(out.shape[1]):"]
    lines += ["        out[:, r] = 0.0", *_added(own, known, 8)]
    terms: dict[tuple[int | None, int | None], list[ChannelTerm]] = {}
    for f in channel_terms:
        if f not in own:
            terms.setdefault((f.weight, f.window_weight), []).append(f)
    for (weight, window_weight), group in terms.items():
        a = f"w[r, {weight}]" if weight is not None else "0.0"
        if window_weight is None:
            lines += [f"        a = {a}", "        if a != 0.0:"]
            lines += _added(group, known, 12, "a")
        else:
            lines += [f"        a, b = {a}, w[r, {window_weight}]"]
            lines += ["        if a != 0.0 or b != 0.0:"]
            lines += _added(group, known, 12, WINDOWED_COEFFICIENT)
    source = "\n".join(lines)
    return _compile(source, _window_code(factors, known, now), input_signals)


def _added(
    functions: Sequence[ChannelTerm],
    known: Mapping[str, str],
    indent: int,
    factor: str | None = None,
) -> list[str]:
    """Return the code that adds functions, times a factor, to the channels of one row."""
    inner = _sum_code(functions, known, factor)
    loop = "for i in range(out.shape[2]):"
    return _indented([loop, *_indented(inner, 4)] if inner else [], indent)


def _sum_code(
    functions: Sequence[ChannelTerm], known: Mapping[str, str], factor: str | None
) -> list[str]:
    """Return the code that adds each function, times a factor, to its channel at one point."""
    writer = CodeWriter(known)
    values = [(f.channel, writer.write(f.expression)) for f in functions]
    first = [f"f = {factor}"] if factor else []
    times = "f * " if factor else ""
    added = [f"out[{channel}, r, i] += {times}{value}" for channel, value in values]
    return [*writer.lines, *first, *added]


def _indented(lines: Sequence[str], indent: int) -> list[str]:
    return [" " * indent + line for line in lines]


def _window_code(
    factors: Sequence[WindowFactor], known: Mapping[str, str], now: Sequence[str]
) -> str:
    """Return the code of the function χ of one point and one row."""
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
    """Compile a kernel; kernels with equal code are compiled once."""
    # The cache keeps the signals, and so their table, as long as the kernel.
    scope: dict[str, Any] = {"math": math, "at": table_reader(input_signals.table)}
    define(f"{window}\n{source}", scope)
    scope["window"] = numba.njit(fastmath=FAST_MATH, error_model="numpy")(scope["window"])
    compiled: Kernel = numba.cfunc(KERNEL, fastmath=FAST_MATH, error_model="numpy")(scope["kernel"])
    return compiled


def names_used(channel_terms: Sequence[ChannelTerm]) -> frozenset[str]:
    """Return the names in the expressions of some channel terms."""
    return frozenset().union(*(names(f.expression) for f in channel_terms))
