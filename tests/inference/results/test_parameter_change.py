"""The new value of a parameter has the effect of the law, if there is such a value."""

from __future__ import annotations

import math

import pytest
import torch

from dashred.inference.results.corrected_system import build_corrected_system, with_parameters
from dashred.inference.results.parameter_change import is_exact, parameter_change
from dashred.physics.system import System, Term
from dashred.physics.terms.library import evaluate_terms
from tests import laws

TEXT = """
system:
  title: a mass on two springs and a cliff
  fields: {q: place, p: momentum}
  parameters: {m: 2, k: 3, depth: 4, sharp: 0.7, shift: 0, rate: 0.5}
  let: {speed: p/m}
  equations:
    q: speed
    p: -k*q - depth**2*q + exp(q/sharp) + shift*q + exp(rate)*p
  start: {q: 1, p: 0}
  spread: {q: 0.1, p: 0.1}
  integrator: {dt: 0.05}
recording: {twin: a, sensors: 1, noise: 0, duration: 4, every: 0.1}
"""


@pytest.fixture(scope="module")
def system(tmp_path_factory: pytest.TempPathFactory) -> System:
    return laws.declared(tmp_path_factory.mktemp("spring"), TEXT)


def tendency(system: System, states: torch.Tensor) -> torch.Tensor:
    own = [Term(field, system.equations[field]) for field in system.fields]
    return evaluate_terms(system, own, states, 0.0)


@pytest.mark.parametrize("to", [1.0, 1.6, 2.2, 6.0])
def test_a_divisor_has_an_exact_change(system: System, to: float) -> None:
    xi = 2.0**2 * (1 / 2.0 - 1 / to)  # 1/m' = 1/m - xi/m²
    assert parameter_change(system, "m", xi) == pytest.approx(to - 2.0, rel=1e-4)
    assert is_exact(system, "m", xi)


@pytest.mark.parametrize("name", ["k", "shift"])
def test_a_linear_parameter_changes_by_its_coefficient(system: System, name: str) -> None:
    assert parameter_change(system, name, -0.37) == -0.37
    assert is_exact(system, name, -0.37)


def test_a_power_has_an_exact_change(system: System) -> None:
    # depth² = 16 + 2·4·xi.
    assert parameter_change(system, "depth", 0.5) == pytest.approx(20**0.5 - 4, rel=1e-8)


def test_without_an_exact_change_it_is_of_first_order(system: System) -> None:
    assert parameter_change(system, "sharp", 0.05) == 0.05
    assert not is_exact(system, "sharp", 0.05)


@pytest.mark.parametrize("xi", [2.001, 2.1, 2.5, 40.0])
def test_no_mass_becomes_infinite(system: System, xi: float) -> None:
    assert parameter_change(system, "m", xi) == xi
    assert not is_exact(system, "m", xi)


@pytest.mark.parametrize("xi", [-0.5, 0.3, 2.0])
def test_a_value_may_change_its_sign(system: System, xi: float) -> None:
    # exp(p) - exp(1/2) = xi exp(1/2).
    change = parameter_change(system, "rate", xi)
    assert change == pytest.approx(math.log(1 + xi), rel=1e-6)


@pytest.mark.parametrize("name", ["m", "k", "depth", "sharp"])
def test_the_corrected_system_has_the_tendency_of_the_law(system: System, name: str) -> None:
    law = laws.law([laws.parameter(system, name)], [0.3])
    states = torch.randn((20, 2), generator=torch.Generator().manual_seed(0)).double()
    [candidate] = law.candidates
    added = torch.zeros((2, 20), dtype=torch.float64)
    for term, column in zip(
        candidate.terms, evaluate_terms(system, candidate.terms, states, 0.0), strict=True
    ):
        added[system.fields.index(term.equation)] += 0.3 * column
    exact = tendency(build_corrected_system(system, law), states) - tendency(system, states)
    torch.testing.assert_close(exact, added, rtol=1e-6, atol=1e-9)
    changed = with_parameters(system, {name: system.config.parameters[name] + 0.3})
    same = torch.allclose(tendency(changed, states) - tendency(system, states), added, rtol=1e-3)
    assert same is (name == "k")
