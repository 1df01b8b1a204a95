"""Changes of the parameters of a program, as terms of a law.

A term of an equation is added to its tendency. A change of a parameter of a program cannot be: the
program is called with the changed value. Its term has no equation but the name of the parameter.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

import numpy as np

from dashred.physics.expressions.algebra import Number
from dashred.physics.external.protocol import Array
from dashred.physics.system import Term

# Begins the equation of a change; it contains a space, so that it is no name of the language.
PARAMETER = "parameter "


def parameter_term(name: str) -> Term:
    """Return the term whose coefficient is the change of a parameter of the program."""
    return Term(PARAMETER + name, Number(1.0))


def changed_parameter(term: Term) -> str | None:
    """Return the parameter of the program that a term changes; None for a term of an equation."""
    return term.equation.removeprefix(PARAMETER) if PARAMETER in term.equation else None


def added_terms(terms: Sequence[Term]) -> tuple[Term, ...]:
    """Return the terms that are added to equations."""
    return tuple(term for term in terms if changed_parameter(term) is None)


def changed_parameters(
    parameters: Mapping[str, float], changes: Mapping[str, float]
) -> dict[str, float]:
    """Return the values of parameters after changes of some of them."""
    return {**parameters, **{name: parameters[name] + c for name, c in changes.items()}}


def parameter_slopes(
    step: Callable[[Mapping[str, float]], Array],
    after: Array,
    parameters: Mapping[str, float],
    names: Sequence[str],
    rounding: float,
) -> Array:
    """Return the derivatives of a step by parameters, ``(name, batch, field, *grid)``.

    They are one-sided differences ``(P(p + δ) - P(p)) / δ``, one step for each parameter. δ is the
    third root of the rounding error, relative to p: the error of a derivative by a parameter that
    enters linearly is then that of rounding, and otherwise far below a percent.

    Args:
        step: (parameters) → states after the step, ``(batch, field, *grid)``.
        after: these with the given parameters.
        parameters: values by name.
        names: of the parameters.
        rounding: relative rounding error of the step.
    """
    found = np.empty((len(names), *after.shape))
    for i, name in enumerate(names):
        value = parameters[name]
        moved = value + rounding ** (1 / 3) * (abs(value) or 1.0)
        found[i] = (step({**parameters, name: moved}) - after) / (moved - value)
    return found
