"""A hidden state as findings."""

from __future__ import annotations

from collections.abc import Sequence

from dashred.core.findings.cause_schema import Cause
from dashred.core.findings.hidden_state_schema import HiddenStateFound
from dashred.core.units import TIME
from dashred.inference.fit.law import Law
from dashred.inference.results.fitted_parameters import fitted_parameters
from dashred.physics.expressions.algebra import names
from dashred.physics.hidden_state import HiddenState
from dashred.physics.system import System
from dashred.physics.terms.term_units import coefficient_unit


def gain_index(law: Law, state: HiddenState | None) -> int | None:
    """Return the index of the term of a law that contains a hidden state; None if none does."""
    if state is None:
        return None
    for index, candidate in enumerate(law.candidates):
        if any(state.name in names(term.expression) for term in candidate.terms):
            return index
    return None


def tell_hidden_state(causes: Sequence[Cause], found: HiddenStateFound | None) -> None:
    """Name the hidden state in the cause of its law, in place."""
    for cause in causes:
        if found is not None and cause.get("extended"):
            cause["hidden_state"] = found["state"]


def hidden_state(system: System, law: Law, state: HiddenState | None) -> HiddenStateFound | None:
    """Return ``findings["hidden_state"]``; None if the law contains no hidden state.

    Args:
        system: the simulator with the hidden state.
        law: fitted with the time constant.
        state: the hidden state, if there is one.
    """
    index = gain_index(law, state)
    if state is None or index is None:
        return None
    candidate = law.candidates[index]
    assert candidate.equation is not None
    [tau] = [p for p in fitted_parameters(system, law) if p["parameter"] == state.constant]
    found = HiddenStateFound(
        state=state.name,
        follows=state.follows,
        equation=candidate.equation,
        term=candidate.name,
        constant=state.constant,
        time_constant=tau["value"],
        time_constant_std=tau["std"],
        time_constant_ci95=tau["ci95"],
        gain=float(law.coefficients[index]),
        gain_std=float(law.std[index]),
        gain_ci95=list(law.interval(index)),
        start=float(law.start[0, system.fields.index(state.name)]),
    )
    if TIME in system.units:
        found["time_unit"] = system.units[TIME]
    key = f"library.{candidate.equation}"
    expression = system.parse(candidate.name, key, equation=candidate.equation)
    unit = coefficient_unit(system, candidate.equation, expression)
    if unit is not None:
        found["gain_unit"] = unit
    return found
