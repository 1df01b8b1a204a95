"""Widths by the evidence, compared with the evidence of a dense normal distribution."""

from __future__ import annotations

import math

import pytest
import torch
from torch import Tensor

from dashred.inference.fit.least_squares import NormalEquations
from dashred.inference.fit.selection.prior_widths import (
    FACTORS,
    _evidence_by_width,
    widen_by_evidence,
    width_penalty,
)
from dashred.inference.fit.selection.subset_search import ProfiledProblem

MODES, CANDIDATES, SAMPLES = 3, 8, 60
FIRST = torch.full((CANDIDATES,), 0.05, dtype=torch.float64)
UNLIMITED = torch.full((CANDIDATES,), math.inf, dtype=torch.float64)


def draw(*shape: int, seed: int) -> Tensor:
    generator = torch.Generator().manual_seed(seed)
    return torch.randn(*shape, generator=generator, dtype=torch.float64)


COLUMNS = draw(SAMPLES, MODES + CANDIDATES, seed=0)


def profiled(coefficients: dict[int, float]) -> tuple[ProfiledProblem, Tensor]:
    """Return the profiled problem of a noisy recording with a few coefficients, and its target."""
    goal = COLUMNS[:, :MODES] @ draw(MODES, seed=1) + draw(SAMPLES, seed=2)
    for candidate, value in coefficients.items():
        goal = goal + value * COLUMNS[:, MODES + candidate]
    count = MODES + CANDIDATES
    precision = torch.cat([torch.ones(MODES, dtype=torch.float64), FIRST**-2])
    zeros = torch.zeros(count, dtype=torch.float64)
    equations = NormalEquations(COLUMNS, precision, zeros, -goal)
    return ProfiledProblem.from_normal_equations(equations, MODES), goal


def evidence(goal: Tensor, widths: Tensor) -> float:
    """Return -2 ln p of the recording, with start and coefficients integrated out."""
    stds = torch.cat([torch.ones(MODES, dtype=torch.float64), widths])
    covariance = torch.eye(SAMPLES, dtype=torch.float64) + (COLUMNS * stds**2) @ COLUMNS.T
    solved = torch.linalg.solve(covariance, goal)
    return float(goal @ solved + torch.linalg.slogdet(covariance)[1])


@pytest.mark.parametrize("candidate", [0, 5])
def test_a_change_of_one_width_is_that_of_the_dense_evidence(candidate: int) -> None:
    problem, goal = profiled({2: 3.0, 5: -1.0})
    present = FIRST.clone()
    present[2] = 3.2
    tried = torch.tensor([[0.05, 0.8]], dtype=torch.float64).expand(CANDIDATES, 2)
    found = _evidence_by_width(problem, present, tried)[candidate]
    dense = []
    for width in tried[candidate]:
        widths = present.clone()
        widths[candidate] = width
        dense.append(evidence(goal, widths))
    assert float(found[1] - found[0]) == pytest.approx(dense[1] - dense[0], rel=1e-6)


def test_only_the_candidates_of_large_coefficients_are_widened() -> None:
    problem, _ = profiled({2: 3.0, 5: -1.0})
    widths = widen_by_evidence(problem, FIRST, UNLIMITED)
    assert torch.nonzero(widths > FIRST).flatten().tolist() == [2, 5]
    assert float(widths[2]) == pytest.approx(FACTORS[-1] * 0.05)


def test_no_width_changes_without_a_large_coefficient() -> None:
    problem, _ = profiled({})
    assert torch.equal(widen_by_evidence(problem, FIRST, UNLIMITED), FIRST)


def test_widths_keep_below_their_limits() -> None:
    problem, _ = profiled({2: 3.0, 5: -1.0})
    limits = UNLIMITED.clone()
    limits[2], limits[5] = 0.5, 0.01
    widths = widen_by_evidence(problem, FIRST, limits)
    assert float(widths[2]) == 0.5
    # A limit below the first width does not narrow it.
    assert float(widths[5]) == 0.05


def test_columns_that_are_not_finite_widen_nothing() -> None:
    problem, _ = profiled({2: 3.0})
    problem.gram[0] = math.nan
    assert torch.equal(widen_by_evidence(problem, FIRST, UNLIMITED), FIRST)


def test_columns_beyond_the_range_of_floats_widen_nothing() -> None:
    """Beside 1e30 the identity is lost, and equal columns make the matrix singular."""
    problem, _ = profiled({2: 3.0})
    problem.gram[:] = 1e30
    assert torch.equal(widen_by_evidence(problem, FIRST, UNLIMITED), FIRST)


def test_the_penalty_grows_with_the_number_of_candidates() -> None:
    assert width_penalty(1) == width_penalty(2) < width_penalty(30)
