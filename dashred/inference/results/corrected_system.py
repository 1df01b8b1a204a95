"""The corrected system: the simulator with the terms and parameter values of a law."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace

from dashred.inference.fit.law import Law
from dashred.inference.results.fitted_parameters import exact_changes
from dashred.physics.expressions.algebra import ZERO, multiply, names
from dashred.physics.parameter_sensitivity import parameter_slopes
from dashred.physics.system import System, Term
from dashred.physics.terms.let_terms import is_exact_change, let_tangents


def build_corrected_system(system: System, law: Law) -> System:
    """Return the corrected system, whose tendency is exactly ``N + Σ ξ θ``.

    Parameters get the values with the same effect as their tangents, if there are such values
    (:func:`dashred.inference.results.fitted_parameters.exact_changes`). For other parameters, such
    as ``alpha`` in ``exp(u/alpha)``, the tangent is added as a term. In the same way a let is
    changed if the equations are affine in it.
    """
    changes = exact_changes(system, law)
    known = system.config.parameters
    changed = {name: known[name] + change for name, change in changes.items()}
    terms: list[tuple[Term, float]] = []
    candidates, coefficients = law.changes
    for candidate, value in zip(candidates, coefficients.tolist(), strict=True):
        if candidate.equation is None:
            if candidate.name not in changes:
                terms.extend((tangent, value) for tangent in _tangents(system, candidate.name))
        else:
            key = f"library.{candidate.equation}"
            expression = system.parse(candidate.name, key, equation=candidate.equation)
            if candidate.window is not None:
                expression = multiply((candidate.window.expression, expression))
            for added in _in_equations(system, Term(candidate.equation, expression), changes):
                if names(system.without_lets(added.expression)) & changes.keys():
                    # It was fitted with the values before the change.
                    added = Term(added.equation, system.resolve(added.expression, key))
                terms.append((added, value))
    return with_parameters(system, changed).with_terms(terms)


def build_fitted_system(system: System, law: Law) -> System:
    """Return the system with the fitted values of uncertain parameters, and without the law.

    Parameters without a value of the same effect keep theirs; see :func:`build_corrected_system`.
    """
    known, changes = system.config.parameters, exact_changes(system, law)
    uncertain = {each.candidate.name for each in law.parameters}
    return with_parameters(
        system, {name: known[name] + changes[name] for name in uncertain & changes.keys()}
    )


def _in_equations(system: System, term: Term, changes: Mapping[str, float]) -> list[Term]:
    """Return a term of a let as tangents of the equations, unless a change of the let is exact."""
    if term.equation not in system.lets:
        return [term]
    tangents = let_tangents(system, term)
    read = set().union(*(names(system.without_lets(added)) for added in tangents.values()))
    if is_exact_change(system, term) and not read & changes.keys():
        return [term]
    return [Term(equation, added) for equation, added in tangents.items()]


def _tangents(system: System, parameter: str) -> Iterator[Term]:
    """Yield ``∂N/∂p`` of every equation, at the parameter values of the system."""
    for equation, slope in parameter_slopes(system, parameter).items():
        tangent = system.resolve(slope, f"system.equations.{equation}")
        if tangent != ZERO:
            yield Term(equation, tangent)


def with_parameters(system: System, values: Mapping[str, float]) -> System:
    """Return the system with other values of some parameters."""
    parameters = system.config.parameters | dict(values)
    return system.with_config(replace(system.config, parameters=parameters))
