"""Candidate terms of a derived quantity (a let) that several equations read.

If ``m`` is a growth rate that the equations of cells, glucose and lactate share, a missing
inhibition changes all of them. A change ``m + ξ θ`` explains them with one coefficient. To first
order in ξ it adds ``ξ ∂N/∂m θ`` to each equation; this is exact if the equations are affine in m.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from dashred.physics.expressions.algebra import (
    ZERO,
    Expr,
    multiply,
    split_coefficient,
)
from dashred.physics.expressions.differentiate import NotDifferentiableError, differentiate
from dashred.physics.system import System, Term

# A change of a let that one equation reads is a term of this equation.
FEWEST_EQUATIONS = 2


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
        NotDifferentiableError: see :func:`differentiate`.
        InputError: the parameters make a constant infinite.
    """
    return tuple(
        Term(equation, system.ready(added, equation, f"library.{term.equation}"))
        for equation, added in let_tangents(system, term).items()
    )


def let_tangents(system: System, term: Term) -> dict[str, Expr]:
    """Return ``∂N/∂m θ`` of each equation that reads the let m, in the names of the system."""
    slopes = let_slopes(system, term.equation)
    return {equation: multiply((slope, term.expression)) for equation, slope in slopes.items()}


def let_slopes(system: System, let: str) -> dict[str, Expr]:
    """Return ``∂N/∂m`` of each equation that reads the let m, directly or through other lets.

    Raises:
        NotDifferentiableError: see :func:`differentiate`.
    """
    slopes = {
        equation: differentiate(system.without_lets(expr, let), let)
        for equation, expr in system.equations.items()
    }
    return {equation: slope for equation, slope in slopes.items() if slope != ZERO}


def is_affine_in(system: System, let: str) -> bool:
    """Return whether every equation is affine in a let, so that its tangents are exact."""
    return all(differentiate(slope, let) == ZERO for slope in let_slopes(system, let).values())


def _default_texts(system: System) -> dict[str, list[str]]:
    """Return a constant, each field, and products of the let with a field and its square."""
    if system.axes or system.config.structure is not None:
        return {}
    shared = [let for let in system.lets if _is_shared(system, let)]
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


def _is_shared(system: System, let: str) -> bool:
    try:
        return len(let_slopes(system, let)) >= FEWEST_EQUATIONS
    except NotDifferentiableError:
        return False
