"""The constant of a function: its slope is right, and the Gauss-Newton iteration converges."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest
import torch
from torch import Tensor

from dashred.inference.fit.selection.subset_search import ProfiledProblem
from dashred.inference.forward.candidates import Candidate
from dashred.inference.hypotheses.extended.nonlinear_constants import (
    fit_constant,
    next_constant,
    parse_tunable_term,
    solve_within_bounds,
)
from dashred.physics.system import System, Term
from dashred.physics.terms.library import evaluate_terms
from tests import laws
from tests.waves import TEXT, Waves

SIGMA = 0.002


@pytest.fixture
def system(tmp_path: Path) -> System:
    return laws.declared(tmp_path, TEXT)


def candidate(system: System, text: str) -> Candidate:
    return replace(laws.term(system, "u", text), is_extended=True)


@pytest.mark.parametrize("text", ["sin(2*u)", "cos(3*v)", "tanh(u)", "exp(-1.5*v)"])
def test_the_slope_agrees_with_finite_differences(system: System, text: str) -> None:
    found = parse_tunable_term(candidate(system, text))
    assert found is not None
    h = 1e-6 * abs(found.constant)
    generator = torch.Generator().manual_seed(0)
    states = torch.randn((3, 2, 32), generator=generator, dtype=torch.float64)
    ends = [found.at(found.constant + sign * h).candidate.terms[0] for sign in (1, -1)]
    ahead, behind = evaluate_terms(system, ends, states, 0.0)
    [slope] = evaluate_terms(system, found.slope.terms, states, 0.0)
    torch.testing.assert_close(slope, (ahead - behind) / (2 * h), rtol=1e-6, atol=1e-6)


@pytest.mark.parametrize("text", ["u**4", "abs(u)", "exp(-u**2)*u", "u*sin(x)", "sin(x)*v"])
def test_other_expressions_have_no_constant(system: System, text: str) -> None:
    assert parse_tunable_term(candidate(system, text)) is None
    parameter = Candidate("nu", None, (Term("u", system.parse("u", "test")),), 1.0)
    assert parse_tunable_term(parameter) is None


def test_a_step_follows_the_coefficients_and_is_bounded(system: System) -> None:
    found = parse_tunable_term(candidate(system, "sin(2*u)"))
    assert found is not None
    assert next_constant(found, 0.5, 0.05) == pytest.approx(2.1)
    assert next_constant(found, 0.01, -5.0) == pytest.approx(1.2)
    assert next_constant(found, 0.0, 1.0) == pytest.approx(2.0)


def linearised(shift: float) -> ProfiledProblem:
    """Return a problem of two columns whose target is the first plus ``shift`` times the second."""
    generator = torch.Generator().manual_seed(1)
    columns = torch.randn((40, 2), generator=generator, dtype=torch.float64)
    goal = columns @ torch.tensor([2.0, 2.0 * shift], dtype=torch.float64)
    precision = torch.tensor([1e-3, 1e-2], dtype=torch.float64)
    return ProfiledProblem(columns.T @ columns, columns.T @ goal, float(goal @ goal), precision)


@pytest.mark.parametrize("constant", [1.5, -1.5])
@pytest.mark.parametrize("shift", [0.4, -0.7, 20.0, -20.0])
def test_the_constant_is_the_best_one_within_bounds(constant: float, shift: float) -> None:
    problem = linearised(shift)
    cost, found = solve_within_bounds(problem, (0, 1), constant)
    gram = problem.gram + torch.diag(problem.precision)

    def left(xi: Tensor) -> float:
        return problem.constant - 2 * float(problem.target @ xi) + float(xi @ gram @ xi)

    assert left(found) == pytest.approx(cost, rel=1e-9)
    ratio = float(found[1] / found[0])
    assert 0.2 - 1e-9 <= 1 + ratio / constant <= 5.0 + 1e-9
    least, most = sorted(factor * constant - constant for factor in (0.2, 5.0))
    for r in torch.linspace(least, most, 400, dtype=torch.float64).tolist():
        along = torch.tensor([1.0, r], dtype=torch.float64)
        best = float(problem.target @ along) / float(along @ gram @ along)
        assert left(best * along) >= cost - 1e-9 * problem.constant


def test_the_constant_is_fitted_through_the_simulator(tmp_path: Path) -> None:
    waves = Waves.declared(tmp_path)
    offered = parse_tunable_term({str(c): c for c in waves.extended}["u: tanh(u)"])
    assert offered is not None
    recorded = waves.recorded(SIGMA, 3, [(offered.at(1.42).candidate, -0.2)])
    objective = waves.objective(recorded, SIGMA)
    begin = torch.zeros(objective.modes + 1, dtype=torch.float64)
    begin[-1] = -0.2
    found, alone, fitted = fit_constant(objective, offered, begin)
    inner = parse_tunable_term(found)
    assert inner is not None and inner.constant == pytest.approx(1.42, abs=0.05)
    assert [c.key for c in alone.forward_model.law.candidates] == [found.key]
    assert fitted.chi2 / objective.noise.count < 1.2
