"""Costs of sets, compared with one ridge regression each that includes the start."""

from __future__ import annotations

from itertools import combinations, pairwise

import pytest
import torch
from torch import Tensor

from dashred.inference.fit.least_squares import NormalEquations
from dashred.inference.fit.selection.subset_search import ProfiledProblem, backward_path, small_sets

MODES, CANDIDATES, SAMPLES = 4, 6, 50


def draw(*shape: int, seed: int) -> Tensor:
    generator = torch.Generator().manual_seed(seed)
    return torch.randn(*shape, generator=generator, dtype=torch.float64)


def normal(columns: Tensor, stds: Tensor, phi: Tensor, residuals: Tensor) -> NormalEquations:
    precision = torch.cat([torch.ones(columns.shape[1] - len(stds)).double(), stds**-2])
    return NormalEquations(columns, precision, phi, residuals)


def towards(goal: Tensor, columns: Tensor, stds: Tensor) -> NormalEquations:
    """Return normal equations at zero unknowns, whose target is ``goal``."""
    return normal(columns, stds, torch.zeros(columns.shape[1], dtype=torch.float64), -goal)


@pytest.fixture(scope="module")
def found() -> tuple[NormalEquations, Tensor, ProfiledProblem]:
    """Normal equations with nearly collinear columns, their target, and the profiled problem."""
    columns = draw(SAMPLES, MODES + CANDIDATES, seed=0)
    columns[:, MODES:] += columns[:, :1] + 0.5 * columns[:, MODES : MODES + 1]
    columns[:, MODES + 2] *= 1e3  # units differ
    stds = torch.tensor([0.5, 2.0, 1e-3, 1.0, 10.0, 0.1], dtype=torch.float64)
    phi, residuals = draw(MODES + CANDIDATES, seed=1), 3 * draw(SAMPLES, seed=2)
    equations = normal(columns, stds, phi, residuals)
    return (
        equations,
        columns @ phi - residuals,
        ProfiledProblem.from_normal_equations(equations, MODES),
    )


def regression(
    equations: NormalEquations, goal: Tensor, members: tuple[int, ...]
) -> tuple[Tensor, float]:
    """Minimise ``‖Jφ - b‖² + φᵀPφ`` over the start and some candidates, as least squares."""
    index = [*range(MODES), *(MODES + j for j in members)]
    root = torch.diag(equations.precision.sqrt())[:, index]
    stacked = torch.cat([equations.jacobian[:, index], root])
    right = torch.cat([goal, torch.zeros(len(root), dtype=torch.float64)])
    solved = torch.linalg.lstsq(stacked, right[:, None]).solution[:, 0]
    return solved[MODES:], float((stacked @ solved - right).square().sum())


def test_costs_and_coefficients_are_those_of_brute_force(
    found: tuple[NormalEquations, Tensor, ProfiledProblem],
) -> None:
    equations, goal, problem = found
    for size in range(CANDIDATES + 1):
        sets = list(combinations(range(CANDIDATES), size))
        costs = problem.costs(sets)
        assert costs.shape == (len(sets),)
        for members, cost in zip(sets, costs.tolist(), strict=True):
            xi, expected = regression(equations, goal, members)
            assert cost == pytest.approx(expected, rel=1e-8)
            if members:
                torch.testing.assert_close(problem.coefficients(members), xi)


def test_chunks_do_not_change_the_costs(
    found: tuple[NormalEquations, Tensor, ProfiledProblem], monkeypatch: pytest.MonkeyPatch
) -> None:
    sets = list(combinations(range(CANDIDATES), 3))
    whole = found[2].costs(sets)
    monkeypatch.setattr("dashred.inference.fit.selection.subset_search.CHUNK", 3)
    torch.testing.assert_close(found[2].costs(sets), whole, rtol=0, atol=1e-12)


def test_columns_that_the_start_can_reproduce_explain_nothing() -> None:
    columns = draw(SAMPLES, 3, seed=3)
    columns[:, 2] = columns[:, :2] @ torch.tensor([1.0, -2.0], dtype=torch.float64)
    goal = 1e-3 * columns[:, 2]
    columns[:, :2] *= 1e4  # the prior of the start is negligible
    equations = towards(goal, columns, torch.tensor([1.0], dtype=torch.float64))
    problem = ProfiledProblem.from_normal_equations(equations, 2)
    empty, alone = float(problem.costs([()])), float(problem.costs([(0,)]))
    assert empty - alone < 1e-6 * float(goal.square().sum())


def test_small_sets_are_all_sets() -> None:
    sizes = [len(sets) for sets in small_sets(6, 3)]
    assert sizes == [1, 6, 15, 20]
    found = [tuple(members) for sets in small_sets(6, 3) for members in sets.tolist()]
    assert len(set(found)) == 42 and all(list(members) == sorted(members) for members in found)


def test_the_backward_path_is_nested_and_drops_the_least_needed(
    found: tuple[NormalEquations, Tensor, ProfiledProblem],
) -> None:
    problem = found[2]
    path = backward_path(problem, CANDIDATES)
    assert [len(members) for members in path] == [6, 5, 4, 3, 2, 1]
    for larger, smaller in pairwise(path):
        others = [tuple(j for j in larger if j != out) for out in larger]
        costs = problem.costs(others)
        assert smaller == others[int(costs.argmin())]
    assert backward_path(problem, 2) == path[-2:]


@pytest.mark.parametrize("decrease", [1e4, 0.0])
def test_updated_inverses_give_the_path_of_fresh_ones(
    decrease: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    columns = draw(SAMPLES, 30, seed=6) + draw(SAMPLES, 1, seed=7)
    columns[:, 20:] = columns[:, :10] + 10.0 ** -torch.arange(10.0).double() * columns[:, 20:]
    # Collinear in stages: each column that is dropped takes a part of the small difference.
    small = torch.tensor([0.1, 1e-3, 1e-5], dtype=torch.float64)
    columns[:, 13] = columns[:, 10] + columns[:, [11, 12, 14]] @ small
    goal = columns[:, [0, 4, 9, 12]].sum(dim=1) + draw(SAMPLES, seed=8)
    problem = ProfiledProblem(
        columns.T @ columns, columns.T @ goal, float(goal @ goal), torch.full((30,), 1e-3).double()
    )
    monkeypatch.setattr("dashred.inference.fit.selection.subset_search.LARGEST_DECREASE", decrease)
    path = backward_path(problem, 6)
    remaining = list(range(30))
    while len(remaining) > 1:
        others = [tuple(j for j in remaining if j != out) for out in remaining]
        remaining = list(others[int(problem.costs(others).argmin())])
        if len(remaining) <= 6:
            assert path[6 - len(remaining)] == tuple(remaining)


def orthogonal(effects: list[float], stds: list[float]) -> ProfiledProblem:
    """Return a problem whose candidates are orthogonal to the start and to each other."""
    q, _ = torch.linalg.qr(draw(SAMPLES, MODES + len(effects), seed=4))
    goal = q[:, MODES:] @ torch.tensor(effects, dtype=torch.float64)
    return ProfiledProblem.from_normal_equations(
        towards(goal, q, torch.tensor(stds, dtype=torch.float64)), MODES
    )


def test_on_orthogonal_columns_the_path_ends_with_the_best_single() -> None:
    effects = [0.3, -5.0, 2.0, 0.1, -3.0]
    path = backward_path(orthogonal(effects, [1e6] * 5), 5)
    assert path == [(0, 1, 2, 3, 4), (0, 1, 2, 4), (1, 2, 4), (1, 4), (1,)]


def test_the_most_distinct_have_the_largest_effects_per_prior() -> None:
    problem = orthogonal([0.0] * 5, [0.1, 3.0, 1.0, 0.2, 2.0])
    assert [problem.most_distinct(count) for count in (1, 2, 3)] == [(1,), (1, 4), (1, 2, 4)]


def test_the_most_distinct_are_not_collinear() -> None:
    q, _ = torch.linalg.qr(draw(SAMPLES, MODES + 3, seed=5))
    q[:, MODES + 1] = q[:, MODES] + 1e-3 * q[:, MODES + 1]
    stds, nothing = torch.tensor([3.0, 2.9, 1.0]).double(), torch.zeros(SAMPLES).double()
    problem = ProfiledProblem.from_normal_equations(towards(nothing, q, stds), MODES)
    assert problem.most_distinct(2) == (0, 2)
