"""Candidate terms of a derived quantity (a let) that several equations read.

If ``m`` is a growth rate that the equations of cells, glucose and lactate share, a missing
inhibition changes all of them. A change ``m + ξ θ`` explains them with one coefficient. To first
order in ξ it adds ``ξ ∂N/∂m θ`` to each equation; this is exact if the equations are affine in m.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from dashred.physics.expressions.algebra import (
    ONE,
    ZERO,
    Expr,
    Name,
    add,
    multiply,
    names,
    split_coefficient,
    substitute,
)
from dashred.physics.expressions.differentiate import differentiate
from dashred.physics.parameter_sensitivity import is_within_function
from dashred.physics.system import System, Term

# A change of a let that one equation reads is a term of this equation.
FEWEST_EQUATIONS = 2
# Name of ξ; it contains a space, so that it is not a name of the equation language.
CHANGE = "change of a let"


def build_let_terms(system: System, listed: Mapping[str, Sequence[str]] | None) -> list[Term]:
    """Return the candidate terms θ of lets, in normal form; their ``equation`` is the let.

    Args:
        system: the simulator.
        listed: expressions by equation or let (configuration key ``library``); None for the
            default, which has terms for systems without axes.
    """
    chosen = _default_texts(system) if listed is None else listed
    found: dict[Term, None] = {}
    for let, texts in chosen.items():
        if let not in system.lets:
            continue
        for text in texts:
            theta = system.parse(text, f"library.{let}")
            found[Term(let, split_coefficient(theta)[1])] = None
    return list(found)


def resolved_let_term(system: System, term: Term) -> tuple[Term, ...]:
    """Return ``∂N/∂m θ`` of each equation that reads the let m, with lets and parameters resolved.

    Args:
        system: the simulator.
        term: θ, a result of :func:`build_let_terms`.

    Raises:
        InputError: the parameters make a constant infinite.
    """
    return tuple(
        Term(equation, system.ready(added, equation, f"library.{term.equation}"))
        for equation, added in let_tangents(system, term).items()
    )


def let_tangents(system: System, term: Term) -> dict[str, Expr]:
    """Return ``∂N/∂m θ`` of each equation that reads the let m, directly or through other lets.

    It is ``d/dξ N(m + ξ θ)`` at ``ξ = 0``, because N may contain derivatives of m in space. Its
    names are those of the system.
    """
    found = {
        equation: substitute(differentiate(changed, CHANGE), {CHANGE: ZERO})
        for equation, changed in _changed(system, term).items()
    }
    return {equation: tangent for equation, tangent in found.items() if tangent != ZERO}


def equations_with_let(system: System, let: str) -> list[str]:
    """Return the equations that a constant change of a let changes."""
    return list(let_tangents(system, Term(let, ONE)))


def is_exact_change(system: System, term: Term) -> bool:
    """Return whether ``m + ξ θ`` adds exactly ``ξ ∂N/∂m θ`` to every equation, for any ξ."""
    changed = _changed(system, term).values()
    return not any(
        is_within_function(expr, {CHANGE}) or CHANGE in names(differentiate(expr, CHANGE))
        for expr in changed
    )


def _changed(system: System, term: Term) -> dict[str, Expr]:
    """Return the equations with ``m + ξ θ`` in place of the let m."""
    let = term.equation
    changed = add((Name(let), multiply((Name(CHANGE), term.expression))))
    return {
        equation: substitute(system.without_lets(expr, let), {let: changed})
        for equation, expr in system.equations.items()
    }


def _default_texts(system: System) -> dict[str, list[str]]:
    """Return a constant, each field, and products of the let with a field and its square."""
    if system.axes or system.config.structure is not None:
        return {}
    shared = [
        let for let in system.lets if len(equations_with_let(system, let)) >= FEWEST_EQUATIONS
    ]
    return {
        let: [
            "1",
            let,
            *system.fields,
            *(f"{let}*{field}" for field in system.fields),
            *(f"{let}*{field}**2" for field in system.fields),
        ]
        for let in shared
    }
