"""The corrected system: the simulator with the terms and parameter values of a law."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace

from dashred.inference.fit.law import Law
from dashred.inference.results.parameter_change import exact_change
from dashred.physics.expressions.algebra import ZERO, multiply
from dashred.physics.parameter_sensitivity import parameter_slopes
from dashred.physics.system import System, Term


def build_corrected_system(system: System, law: Law) -> System:
    """Return the corrected system, whose tendency is exactly ``N + Σ ξ θ``.

    Uncertain parameters get their fitted values. A parameter gets the value with the same effect as
    its tangent, if there is one (:mod:`dashred.inference.results.parameter_change`). For other
    parameters, such as ``alpha`` in ``exp(u/alpha)``, the tangent is added as a term.
    """
    changed: dict[str, float] = {}
    terms: list[tuple[Term, float]] = []
    fitted = [(each.candidate, each.change) for each in law.parameters]
    for candidate, value in [*fitted, *zip(law.candidates, law.coefficients.tolist(), strict=True)]:
        if candidate.equation is None:
            change = exact_change(system, candidate.name, value)
            if change is None:
                terms.extend((tangent, value) for tangent in _tangents(system, candidate.name))
            else:
                changed[candidate.name] = system.config.parameters[candidate.name] + change
        else:
            key = f"library.{candidate.equation}"
            expression = system.parse(candidate.name, key, equation=candidate.equation)
            if candidate.window is not None:
                expression = multiply((candidate.window.expression, expression))
            terms.append((Term(candidate.equation, expression), value))
    return with_parameters(system, changed).with_terms(terms)


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
