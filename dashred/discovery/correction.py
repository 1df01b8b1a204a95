"""The simulator with a law put in: missing terms as text, mis-stated parameters as new values."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

from dashred.discovery.law import Law
from dashred.discovery.parameter_change import parameter_change
from dashred.physics.algebra import multiply
from dashred.physics.system import System, Term


def correct(system: System, law: Law) -> System:
    """Return the system that the law says is real.

    Its tendency is ``N + Σ ξ θ`` exactly for terms and for parameters whose effect keeps its shape
    (:mod:`dashred.discovery.parameter_change`); for the others (``alpha`` in ``exp(u/alpha)``) the
    law is their tangent, so the two agree to first order in the change.
    """
    changed: dict[str, float] = {}
    terms: list[tuple[Term, float]] = []
    for candidate, value in zip(law.candidates, law.coefficients.tolist(), strict=True):
        if candidate.equation is None:
            change = parameter_change(system, candidate.name, value)
            changed[candidate.name] = system.config.parameters[candidate.name] + change
        else:
            key = f"library.{candidate.equation}"
            expression = system.parse(candidate.name, key, equation=candidate.equation)
            if candidate.window is not None:
                expression = multiply((candidate.window.expression, expression))
            terms.append((Term(candidate.equation, expression), value))
    return with_parameters(system, changed).with_terms(terms)


def with_parameters(system: System, values: Mapping[str, float]) -> System:
    """Return the system with other values of some parameters."""
    parameters = system.config.parameters | dict(values)
    return system.declared_as(replace(system.config, parameters=parameters))
