"""The coefficient of a term at which a time step is no longer stable."""

from __future__ import annotations

import math
from collections.abc import Sequence

import torch

from dashred.physics.cells.operator_matrices import fastest_linear_rate
from dashred.physics.expressions.linear import split_linear
from dashred.physics.expressions.reflection import without_sides
from dashred.physics.grids.fourier_symbols import symbols
from dashred.physics.grids.spectral import Spectral
from dashred.physics.system import System, Term


def stable_limit(system: System, terms: Sequence[Term]) -> float:
    """Return the |ξ| at which the fastest mode of ``ξ θ`` grows by a factor of e within a step.

    Only the linear part of θ counts. For a term of fourth order the natural scale is far above this
    limit, and the first trial would blow up (docs/method.md#scales-and-priors).

    Args:
        system: the simulator.
        terms: θ, by equation; resolved.
    """
    if not isinstance(system.operators, Spectral):
        rate = fastest_linear_rate(system, terms) if system.has_conditions else 0.0
        return 1.0 / (rate * system.dt) if rate else math.inf
    fastest = 0.0
    for term in terms:
        bare = without_sides(term.expression)
        for field in system.fields:
            linear, _ = split_linear(bare, field)
            if linear:
                # A term with the side factor of a reflection is integrated explicitly, too.
                own = field == term.equation and bare == term.expression
                found = symbols([linear], system.operators, torch.device("cpu"))[0]
                fastest = max(fastest, float((found.real if own else found).abs().max()))
    return 1.0 / (fastest * system.dt) if fastest else math.inf
