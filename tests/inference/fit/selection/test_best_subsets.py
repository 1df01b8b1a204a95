"""The best sets, compared with the costs of all sets."""

from __future__ import annotations

import math

import pytest
import torch
from torch import Tensor

from dashred.inference.fit.selection.best_subsets import best_subsets
from dashred.inference.fit.selection.subset_search import ProfiledProblem

MODULE = "dashred.inference.fit.selection.best_subsets"
SAMPLES = 150


def problem_of(columns: Tensor, goal: Tensor, precision: float = 1e-2) -> ProfiledProblem:
    """Return the problem of some columns without a start."""
    return ProfiledProblem(
        columns.T @ columns,
        columns.T @ goal,
        float(goal @ goal),
        torch.full((columns.shape[1],), precision, dtype=torch.float64),
    )


def correlated_problem(count: int, seed: int) -> ProfiledProblem:
    """Return a problem with correlated columns in different units, and a target of three."""
    generator = torch.Generator().manual_seed(seed)
    noise = torch.randn(SAMPLES, count + 2, generator=generator, dtype=torch.float64)
    columns = noise[:, :count] + noise[:, count, None]
    columns[:, 1] = columns[:, 0] + 1e-4 * columns[:, 1]
    columns[:, 2] = columns[:, 3] - columns[:, 4] + 1e-2 * columns[:, 2]
    goal = columns[:, [0, 5, count - 1]].sum(dim=1) + noise[:, count + 1]
    units = 10.0 ** torch.randint(-3, 4, (count,), generator=generator)
    return problem_of(columns * units, goal)


def all_sets(problem: ProfiledProblem, size: int) -> tuple[Tensor, Tensor]:
    """Return all sets of a size by their costs, and the costs."""
    sets = torch.combinations(torch.arange(len(problem.target)), size)
    costs, order = problem.costs(sets).sort()
    return sets[order], costs


@pytest.mark.parametrize("size", [1, 2, 3])
@pytest.mark.parametrize("seed", range(6))
def test_the_best_sets_are_those_of_all_sets(size: int, seed: int) -> None:
    problem = correlated_problem(40, seed)
    sets, costs = all_sets(problem, size)
    assert math.comb(40, size) > 500 or size == 1
    found = best_subsets(problem, size, 8)
    torch.testing.assert_close(found, sets[:8])
    torch.testing.assert_close(problem.costs(found), costs[:8], rtol=1e-12, atol=0)


@pytest.mark.parametrize("elements", [1, 20_000, 10**7])
def test_the_number_of_matrices_at_once_changes_nothing(
    elements: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    problem = correlated_problem(40, 11)
    monkeypatch.setattr(f"{MODULE}.ELEMENTS", elements)
    torch.testing.assert_close(best_subsets(problem, 3, 8), all_sets(problem, 3)[0][:8])


def test_few_sets_are_solved_for(monkeypatch: pytest.MonkeyPatch) -> None:
    problem = correlated_problem(80, 12)
    solved = 0
    costs = ProfiledProblem.costs

    def counted(self: ProfiledProblem, sets: Tensor) -> Tensor:
        nonlocal solved
        solved += len(sets)
        return costs(self, sets)

    monkeypatch.setattr(ProfiledProblem, "costs", counted)
    best_subsets(problem, 3, 8)
    assert solved < math.comb(80, 3) / 50


@pytest.mark.parametrize("size", [2, 3])
def test_candidates_of_equal_effect_are_all_found(size: int) -> None:
    generator = torch.Generator().manual_seed(13)
    columns = torch.randn(SAMPLES, 40, generator=generator, dtype=torch.float64)
    columns[:, 20:22] = columns[:, :1]
    problem = problem_of(columns, columns[:, 0] + 0.5 * columns[:, 7] + 0.2 * columns[:, 30])
    found = {tuple(members) for members in best_subsets(problem, size, 3).tolist()}
    rest = (7,) if size == 2 else (7, 30)
    assert found == {tuple(sorted((twin, *rest))) for twin in (0, 20, 21)}


@pytest.mark.parametrize("value", [0.0, math.nan])
def test_without_a_gain_some_sets_are_returned(value: float) -> None:
    problem = correlated_problem(40, 14)
    nothing = ProfiledProblem(
        problem.gram, torch.full_like(problem.target, value), 1.0, problem.precision
    )
    assert best_subsets(nothing, 3, 8).shape == (8, 3)


def test_more_candidates_than_sets_that_are_solved_for_at_once() -> None:
    generator = torch.Generator().manual_seed(16)
    columns = torch.randn(SAMPLES, 501, generator=generator, dtype=torch.float64)
    problem = problem_of(columns, 2 * columns[:, 7] + columns[:, 500])
    assert best_subsets(problem, 1, 1).tolist() == [[7]]
    assert best_subsets(problem, 2, 1).tolist() == [[7, 500]]


def test_more_sets_than_there_are() -> None:
    problem = correlated_problem(6, 15)
    sets, _ = all_sets(problem, 2)
    torch.testing.assert_close(best_subsets(problem, 2, 100), sets)
