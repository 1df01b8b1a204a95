"""Sensors that read a product of inputs and a function of the state: the power ``I*v``.

With ``y = f(e, t) h(u) + g(e, t)`` and noise of the standard deviation σ, ``(y - g)/f`` reads
``h(u)`` with the noise ``σ/|f|``. A reading at ``f = 0`` says nothing of the state.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from dashred.data.inputs import values_at_times
from dashred.data.recording import Recording
from dashred.physics.expressions.algebra import Expr, Product, add, multiply, names, to_text
from dashred.physics.system import System

# A reading counts as missing if its factor is smaller than this share of the typical one.
SMALLEST = 1e-2


class Factored(NamedTuple):
    """Terms of a quantity as ``factor * of_state``."""

    factor: Expr
    of_state: Expr


def factored(terms: Sequence[Expr], clock: Collection[str]) -> Factored | None:
    """Return terms as a product; None if they have no common factor of inputs and time.

    Args:
        terms: each depends on the state.
        clock: names of the inputs and of time.
    """
    clock = frozenset(clock)
    found = [_split_term(term, clock) for term in terms]
    common = {to_text(factor) for factor, _ in found}
    if len(common) != 1:
        return None
    factor, rest = found[0][0], add([rest for _, rest in found])
    if not names(factor) or not names(factor) <= clock or names(rest) & clock:
        return None
    return Factored(factor, rest)


def typical_factor(values: Sequence[NDArray[np.float64]]) -> float:
    """Return the median of ``|f|`` where f is not 0; 0 if it is 0 everywhere.

    Args:
        values: of f at the samples of every episode.
    """
    sizes = np.abs(np.concatenate(values))
    sizes = sizes[np.isfinite(sizes) & (sizes > 0)]
    return float(np.median(sizes)) if sizes.size else 0.0


def divided(text: str, factor: Expr, typical: float) -> str:
    """Return the text of ``g/f``, 0 where f is too small."""
    divisor = to_text(factor)
    return f"where(abs({divisor}) > {SMALLEST * typical!r}, ({text})/({divisor}), 0)"


def noise_factors(recording: Recording, system: System) -> NDArray[np.float64] | None:
    """Return σ of every reading over that of its sensor, ``(time, sensor)``; None if all are 1.

    Args:
        recording: of readings that were divided by their factors.
        system: with the factors as lets, driven by its inputs.
    """
    if not any(sensor.factor for sensor in recording.sensors):
        return None
    found = np.ones_like(recording.values)
    for column, sensor in enumerate(recording.sensors):
        if sensor.factor:
            sizes = np.abs(values_at_times(system, sensor.factor, recording.times))
            found[:, column] = 1 / np.maximum(sizes, SMALLEST)
    return found


def with_even_noise(recording: Recording, system: System) -> Recording:
    """Return a recording with the same noise in all readings of a sensor: times their factors.

    Args:
        recording: of readings that were divided by their factors.
        system: with the factors as lets, driven by its inputs.
    """
    factors = noise_factors(recording, system)
    return recording if factors is None else replace(recording, values=recording.values / factors)


def _split_term(term: Expr, clock: frozenset[str]) -> tuple[Expr, Expr]:
    """Return the factors that depend on inputs or time, and the others."""
    parts = term.factors if isinstance(term, Product) else (term,)
    return (
        multiply([part for part in parts if names(part) & clock]),
        multiply([part for part in parts if not names(part) & clock]),
    )
