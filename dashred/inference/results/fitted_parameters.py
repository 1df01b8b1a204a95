"""Uncertain parameters that were fitted beside the law, as findings."""

from __future__ import annotations

from dashred.core.findings.law_schema import FittedParameter
from dashred.inference.fit import law as fit
from dashred.inference.fit.law import Z95, Law
from dashred.inference.results.parameter_change import exact_change, parameter_change
from dashred.physics.system import System


def fitted_parameters(system: System, law: Law) -> list[FittedParameter]:
    """Return ``findings["fitted_parameters"]``: one entry for each uncertain parameter.

    Args:
        system: the simulator, about whose parameters the law is linearised.
        law: with the fitted parameters.
    """
    return [_entry(system, each) for each in law.parameters]


def _entry(system: System, fitted: fit.FittedParameter) -> FittedParameter:
    name, prior = fitted.candidate.name, fitted.candidate.prior
    assert prior is not None
    current = system.config.parameters[name]
    value = current + parameter_change(system, name, fitted.change)
    ends = [
        current + parameter_change(system, name, fitted.change + sign * fitted.std / 2)
        for sign in (-1, 1)
    ]
    std = abs(ends[1] - ends[0])
    found = FittedParameter(
        parameter=name,
        stated=current + prior.mean,
        spread=prior.std,
        value=value,
        std=std,
        ci95=[value - Z95 * std, value + Z95 * std],
        aliases=list(fitted.candidate.aliases),
        exact=exact_change(system, name, fitted.change) is not None,
    )
    if name in system.units:
        found["unit"] = system.units[name]
    return found
