"""The values of fitted parameters, and the corrected system, have the effect of the law."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest
import torch

from dashred.inference.fit.law import FittedParameter, Law
from dashred.inference.forward.candidates import ChangePrior
from dashred.inference.results.corrected_system import build_corrected_system
from dashred.inference.results.fitted_parameters import fitted_parameters
from dashred.physics.system import System, Term
from dashred.physics.terms.library import evaluate_terms
from tests import laws

TEXT = """
system:
  title: growth that saturates
  fields: {u: amount}
  parameters: {r: 1.0, K: 2.0, c: 0.3}
  units: {K: kg}
  equations: {u: r*u*(1 - u/K) - c*u**3}
  start: {u: 0.5}
  integrator: {method: rk4, dt: 0.05}
recording: {twin: a, sensors: 1, noise: 0, duration: 4, every: 0.1}
"""
STATES = torch.tensor([[0.3], [0.9], [1.7], [2.4]], dtype=torch.float64)


@pytest.fixture
def system(tmp_path: Path) -> System:
    return laws.declared(tmp_path, TEXT)


def law(system: System, changes: dict[str, float], std: float = 0.01, **terms: float) -> Law:
    """Return a law of fitted parameters, and of terms in the equation of u."""
    parameters = tuple(
        FittedParameter(
            replace(laws.parameter(system, name), prior=ChangePrior(0.0, 0.4)), change, std
        )
        for name, change in changes.items()
    )
    candidates = [laws.term(system, "u", text) for text in terms]
    return replace(laws.law(candidates, list(terms.values())), parameters=parameters)


def tendency(system: System) -> torch.Tensor:
    return evaluate_terms(system, [Term("u", system.equations["u"])], STATES, 0.0)[0]


def fitted_tendency(system: System, found: Law) -> torch.Tensor:
    """Return ``N + Σ ξ ∂N/∂p + Σ ξ θ``."""
    pairs = [(each.candidate, each.change) for each in found.parameters]
    pairs += zip(found.candidates, found.coefficients.tolist(), strict=True)
    total = tendency(system)
    for candidate, value in pairs:
        total = total + value * evaluate_terms(system, candidate.terms, STATES, 0.0).sum(dim=0)
    return total


@pytest.mark.parametrize(
    "changes", [{"r": 0.4}, {"K": -0.6}, {"r": 0.4, "K": -0.6}, {"c": 0.2}, {"c": 0.2, "r": 0.3}]
)
def test_the_corrected_system_has_the_fitted_tendency(
    system: System, changes: dict[str, float]
) -> None:
    found = law(system, changes)
    corrected = build_corrected_system(system, found)
    torch.testing.assert_close(tendency(corrected), fitted_tendency(system, found))
    exact = [each["exact"] for each in fitted_parameters(system, found)]
    # The product of r and 1/K is not affine in both.
    assert all(exact) == (set(changes) != {"r", "K"})


def test_small_changes_are_told_as_values(system: System) -> None:
    """After the search was repeated about the fitted values."""
    found = law(system, {"r": 0.001, "K": -0.002})
    corrected = build_corrected_system(system, found)
    assert corrected.config.parameters == {"r": 1.001, "K": 1.998, "c": 0.3}
    assert all(each["exact"] for each in fitted_parameters(system, found))
    torch.testing.assert_close(
        tendency(corrected), fitted_tendency(system, found), rtol=1e-4, atol=1e-5
    )


def test_a_term_keeps_the_values_with_which_it_was_fitted(system: System) -> None:
    found = law(system, {"c": 0.2}, **{"c*u**2": -0.5})
    corrected = build_corrected_system(system, found)
    torch.testing.assert_close(tendency(corrected), fitted_tendency(system, found))
    assert corrected.config.parameters["c"] == pytest.approx(0.5)


def test_the_entry_of_a_parameter(system: System) -> None:
    [entry] = fitted_parameters(system, law(system, {"c": 0.2}))
    assert entry["value"] == pytest.approx(0.5) and entry["std"] == pytest.approx(0.01)
    assert (entry["parameter"], entry["stated"], entry["spread"]) == ("c", 0.3, 0.4)
    assert "unit" not in entry
    [entry] = fitted_parameters(system, law(system, {"K": 0.0}))
    assert entry["unit"] == "kg"
    # K divides: a change ξ of its tangent is not the change of K.
    [entry] = fitted_parameters(system, law(system, {"K": -0.6}))
    assert entry["value"] == pytest.approx(1 / (1 / 2.0 + 0.6 / 2.0**2))
