"""Uncertain parameters that were fitted beside the law, as findings."""

from __future__ import annotations

from collections.abc import Mapping

from dashred.core.findings.law_schema import FittedParameter
from dashred.core.formatting import Z95
from dashred.inference.fit import law as fit
from dashred.inference.fit.law import Law
from dashred.inference.results.parameter_change import exact_change, parameter_change
from dashred.physics.parameter_sensitivity import act_separately, acts_linearly
from dashred.physics.system import System

# A change by at most this share of its posterior std is too small for the tangent to differ.
SETTLED = 0.5


def fitted_parameters(
    system: System, law: Law, described: Mapping[str, Mapping[str, str]] | None = None
) -> list[FittedParameter]:
    """Return ``findings["fitted_parameters"]``: one entry for each uncertain parameter.

    Args:
        system: the simulator, about whose parameters the law is linearised.
        law: with the fitted parameters.
        described: the ``sensor``, ``input`` or ``episode`` of parameters that belong to one.
    """
    changes, known = exact_changes(system, law), described or {}
    found = [_entry(system, each, changes) for each in law.parameters]
    for each in found:
        own = known.get(each["parameter"], {})
        if "input" in own:
            each["input"] = own["input"]
        if "sensor" in own:
            each["sensor"] = own["sensor"]
        if "episode" in own:
            each["episode"] = own["episode"]
    return found


def exact_changes(system: System, law: Law) -> dict[str, float]:
    """Return the changes of parameters that together have the effect of a law.

    A law adds ``ξ ∂N/∂p`` for each changed parameter. Other values of several parameters have that
    effect if the equations are affine in them; if no effect depends on another parameter, and each
    changes its tangent by a factor alone; or if the changes of uncertain parameters are small. A
    parameter without such a value is not in the result. Those that a program reads were fitted
    exactly.

    Args:
        system: the simulator, about whose parameters the law is linearised.
        law: the law.
    """
    candidates, coefficients = law.changes
    pairs = [*zip(candidates, coefficients.tolist(), strict=True)]
    own = {c.name: value for c, value in pairs if c.in_program}
    return _exact_in_equations(system, law) | own


def _exact_in_equations(system: System, law: Law) -> dict[str, float]:
    candidates, coefficients = law.changes
    pairs = zip(candidates, coefficients.tolist(), strict=True)
    changed = {c.name: value for c, value in pairs if c.equation is None}
    if acts_linearly(system, changed):
        return changed
    if not law.parameters or act_separately(system, changed):
        # Each is told by itself.
        alone = {name: exact_change(system, name, xi) for name, xi in changed.items()}
        exact = {name: change for name, change in alone.items() if change is not None}
        if not law.parameters or len(exact) == len(changed):
            return exact
    is_settled = all(abs(each.change) <= SETTLED * each.std for each in law.parameters)
    return {each.candidate.name: each.change for each in law.parameters} if is_settled else {}


def _entry(
    system: System, fitted: fit.FittedParameter, changes: dict[str, float]
) -> FittedParameter:
    name, prior = fitted.candidate.name, fitted.candidate.prior
    assert prior is not None
    current = system.config.parameters[name]
    value = current + changes.get(name, fitted.change)
    ends = [
        parameter_change(system, name, fitted.change + sign * fitted.std / 2) for sign in (-1, 1)
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
        exact=name in changes,
    )
    if name in system.units:
        found["unit"] = system.units[name]
    return found
