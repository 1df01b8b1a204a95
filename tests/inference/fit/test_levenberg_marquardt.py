"""Fits of a linear problem take one step; a fit that blows up does not change others."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import pytest
import torch
from torch import Tensor

from dashred.inference.fit.least_squares import LeastSquaresProblem, NormalEquations
from dashred.inference.fit.levenberg_marquardt import (
    LADDER,
    LOOSE,
    FitResult,
    Refits,
    _step,
    chord_refits,
    minimise,
)
from tests.swing import DRIVES, TIMES, Swing, noisy, ridge

SIGMA, PRIOR = 0.05, (0.5, 0.02, 1.0, 0.3)
Z, XI = (0.8, -0.6), (0.2, 0.01, -0.3, 0.1)


@pytest.fixture(scope="module")
def linear(swing: Swing) -> LeastSquaresProblem:
    """Forces that depend only on time, missing samples, and correlated noise of two sizes."""
    recorded = noisy(swing.clean(Z, DRIVES, XI), SIGMA, seed=0)
    recorded[7:12, 1] = torch.nan
    found = swing.objective(DRIVES, recorded, SIGMA, PRIOR)
    std = torch.tensor([SIGMA, 2 * SIGMA], dtype=torch.float64)
    noise = type(found.noise)(std, torch.full_like(std, 0.4), found.noise.available)
    return LeastSquaresProblem(found.forward_model, recorded, noise, found.prior_std)


@pytest.fixture(scope="module")
def bent(swing: Swing) -> LeastSquaresProblem:
    """Two candidates with a nonlinear effect; x³ with a positive sign diverges."""
    recorded = noisy(swing.clean(Z, ("p**3", "x**3"), (-0.2, -0.3)), SIGMA, seed=1)
    return swing.objective(("p**3", "x**3"), recorded, SIGMA, 1.0)


def normal(objective: LeastSquaresProblem, phi: Tensor) -> NormalEquations:
    return objective.linearise(phi)


def nothing(objective: LeastSquaresProblem) -> Tensor:
    return torch.zeros(objective.modes + len(objective.prior_std), dtype=torch.float64)


def freedom(objective: LeastSquaresProblem, sets: Sequence[tuple[int, ...]]) -> Tensor:
    free = torch.zeros((len(sets), len(nothing(objective))), dtype=torch.bool)
    for row, members in enumerate(sets):
        free[row, objective.indices(members)] = True
    return free


def refits(
    objective: LeastSquaresProblem,
    begin: Tensor,
    free: Tensor,
    steps: int,
    hopeless: float = torch.inf,
) -> Refits:
    equations = normal(objective, nothing(objective))
    return chord_refits(objective, equations, begin, free, steps, 1e-6, hopeless)


def test_a_known_jacobian_is_not_computed_again(linear: LeastSquaresProblem) -> None:
    begin = nothing(linear)
    wide = replace(linear, prior_std=3 * linear.prior_std)
    again = minimise(linear, begin, 1, 1e-6)
    known = minimise(linear, begin, 1, 1e-6, normal(wide, begin))
    torch.testing.assert_close(known.phi, again.phi, rtol=0, atol=0)

    astray = replace(normal(linear, begin), is_finite=False)
    assert minimise(linear, begin, 1, 1e-6, astray).jacobians == 0


def test_values_whose_square_overflows_are_not_finite(linear: LeastSquaresProblem) -> None:
    """A trajectory that is blowing up: its readings are still finite."""
    far = replace(linear, noise=linear.noise.scaled(1e-200))
    found = normal(far, nothing(linear))
    assert not found.is_finite and bool(torch.isfinite(found.hessian).all())
    assert normal(linear, nothing(linear)).is_finite


def test_one_step_reaches_the_exact_solution(linear: LeastSquaresProblem) -> None:
    phi, cost, _ = ridge(linear, range(4))
    found = minimise(linear, nothing(linear), 1, 1e-6)
    torch.testing.assert_close(found.phi, phi, rtol=1e-7, atol=1e-8)
    assert found.cost == pytest.approx(cost, rel=1e-9)
    residuals = linear.residuals(found.readings)
    assert found.chi2 == pytest.approx(float(residuals.square().sum()), rel=1e-12)
    assert found.cost - found.chi2 == pytest.approx(float(linear.penalty(found.phi)), rel=1e-9)
    assert not found.converged
    assert minimise(linear, nothing(linear), 2, 1e-6).converged


def test_the_solution_is_that_of_a_kalman_update(linear: LeastSquaresProblem) -> None:
    """The gain form needs neither J'J nor the precision, and gives the same estimate."""
    equations = normal(linear, nothing(linear))
    prior = torch.diag(1 / equations.precision)
    jacobian = equations.jacobian
    [goal] = -linear.residuals(linear.forward_model.readings(*linear.split(nothing(linear)[None])))
    spread = jacobian @ prior @ jacobian.T + torch.eye(len(goal), dtype=torch.float64)
    expected = prior @ jacobian.T @ torch.linalg.solve(spread, goal)
    found = minimise(linear, nothing(linear), 1, 1e-6)
    torch.testing.assert_close(found.phi, expected, rtol=1e-6, atol=1e-7)


def test_the_solution_is_near_the_truth_with_missing_samples(
    linear: LeastSquaresProblem,
) -> None:
    found = minimise(linear, nothing(linear), 2, 1e-6)
    _, _, covariance = ridge(linear, range(4))
    truth = torch.tensor([*Z, *XI], dtype=torch.float64)
    assert float(((found.phi - truth) / covariance.diagonal().sqrt()).abs().max()) < 3.5
    other = linear.recorded.clone()
    other[7:12, 1] = 1e6
    same = LeastSquaresProblem(linear.forward_model, other, linear.noise, linear.prior_std)
    torch.testing.assert_close(minimise(same, nothing(linear), 2, 1e-6).phi, found.phi)


def test_a_subset_of_the_candidates_and_of_the_record(linear: LeastSquaresProblem) -> None:
    part = linear.subset([2, 0]).truncate(30)
    assert len(part.forward_model.times) == 30 < len(TIMES)
    found = minimise(part, nothing(part), 1, 1e-6)
    torch.testing.assert_close(found.phi, ridge(part, range(2))[0], rtol=1e-7, atol=1e-7)
    whole = linear.embed(found.phi, [2, 0])
    assert whole[[4, 2]].tolist() == found.phi[2:].tolist() and not whole[[3, 5]].any()
    assert torch.equal(whole[linear.indices([2, 0])], found.phi)


def test_chord_refits_of_several_sets_equal_separate_exact_solutions(
    linear: LeastSquaresProblem,
) -> None:
    sets: list[tuple[int, ...]] = [(), (0,), (2,), (1, 3), (0, 2, 3), (0, 1, 2, 3)]
    begin = nothing(linear).expand(len(sets), -1)
    found = refits(linear, begin, freedom(linear, sets), 8)
    assert found.converged.all()
    for row, members in enumerate(sets):
        phi, cost, _ = ridge(linear, members)
        torch.testing.assert_close(found.phi[row], phi, rtol=1e-6, atol=1e-7)
        assert float(found.cost[row]) == pytest.approx(cost, rel=1e-9)


def test_chord_steps_reach_the_minimum_of_a_nonlinear_problem(bent: LeastSquaresProblem) -> None:
    exact = minimise(bent, nothing(bent), 20, 1e-12)
    equations = normal(bent, exact.phi)
    begin = (exact.phi + torch.tensor([0.2, -0.2, 0.03, -0.03]).double())[None]
    free = freedom(bent, [(0, 1)])
    found = chord_refits(bent, equations, begin, free, 20, 1e-9, torch.inf)
    torch.testing.assert_close(found.phi[0], exact.phi, rtol=1e-4, atol=1e-5)
    assert float(found.cost[0]) == pytest.approx(exact.cost, rel=1e-7)


def test_a_row_that_blows_up_does_not_change_the_others(bent: LeastSquaresProblem) -> None:
    sets: list[tuple[int, ...]] = [(0,), (0, 1), (1,)]
    begin = nothing(bent).repeat(3, 1)
    alone = refits(bent, begin, freedom(bent, sets), 8)
    assert torch.isfinite(alone.cost).all()
    runaway = nothing(bent)[None].clone()
    runaway[0, 3] = 50.0
    mixed = torch.cat([begin[:1], runaway, begin[1:]])
    assert torch.isinf(bent.values(runaway)[0]).all()
    found = refits(bent, mixed, freedom(bent, [(0,), (0, 1), (0, 1), (1,)]), 8)
    others = [0, 2, 3]
    torch.testing.assert_close(found.phi[others], alone.phi, rtol=1e-12, atol=1e-12)
    torch.testing.assert_close(found.cost[others], alone.cost, rtol=1e-12, atol=0)
    assert found.converged[others].tolist() == alone.converged.tolist()


def test_where_small_dampings_all_overshoot_larger_ones_are_tried(
    linear: LeastSquaresProblem,
) -> None:
    """The Jacobian is too small by a factor of 100: even a quarter of the step is far too long."""
    phi = nothing(linear)
    about = normal(linear, phi)
    flat = replace(about, jacobian=about.jacobian / 100, precision=about.precision * 1e-4)
    [cost], (readings, _) = linear.values(phi[None])
    here = FitResult(phi, float(cost), float(cost), readings[0], False, 0)
    assert _step(linear, flat, here, LADDER[:1]) is here
    lower = _step(linear, flat, here, LADDER)
    assert lower.cost < here.cost
    assert lower.cost == pytest.approx(float(linear.values(lower.phi[None])[0][0]))


def test_a_step_that_overshoots_is_damped_until_it_gains(bent: LeastSquaresProblem) -> None:
    """The Jacobian is too small by a factor of 50; the row without candidates is unaffected."""
    begin, free = nothing(bent).repeat(2, 1), freedom(bent, [(0, 1), ()])
    flat = torch.tensor([1.0, 1.0, 0.02, 0.02], dtype=torch.float64)
    precision = torch.tensor([1.0, 1.0, 1e-6, 1e-6], dtype=torch.float64)
    about = normal(bent, nothing(bent))
    wild = replace(about, jacobian=about.jacobian * flat, precision=precision)
    before, (_, residuals) = bent.values(begin)
    step = wild.steps(begin, residuals, torch.zeros(2).double(), free)
    assert float(bent.values(begin + step)[0][0]) > 2 * float(before[0])
    found = chord_refits(bent, wild, begin, free, 8, 1e-6, torch.inf)
    assert float(found.cost[0]) < 0.5 * float(before[0])
    alone = chord_refits(bent, wild, begin[1:], free[1:], 8, 1e-6, torch.inf)
    torch.testing.assert_close(found.phi[1:], alone.phi, rtol=1e-12, atol=1e-12)
    assert not found.phi[1, 2:].any()


def test_rows_far_above_the_best_are_given_up_early(bent: LeastSquaresProblem) -> None:
    free = freedom(bent, [(0, 1), (0,)])
    begin = nothing(bent).repeat(2, 1)
    far, near = (refits(bent, begin, free, 12, hopeless) for hopeless in (torch.inf, 1.0))
    torch.testing.assert_close(near.phi[0], far.phi[0], rtol=1e-9, atol=1e-12)
    assert near.converged[1] and float(near.cost[1]) > float(far.cost[1]) + 1e-3
    assert float(far.cost[1]) > 2 * float(far.cost[0])


def test_minimise_descends_where_the_full_step_does_not(bent: LeastSquaresProblem) -> None:
    phi = nothing(bent)
    phi[:2] = torch.tensor([5.0, -5.0])
    [before] = bent.values(phi[None])[0]
    found = minimise(bent, phi, 15, 1e-8)
    assert found.converged and found.cost < 0.01 * float(before)
    count = bent.noise.count
    assert 0.7 < found.chi2 / count < 1.3


def test_a_start_that_blows_up_is_returned_with_an_infinite_cost(bent: LeastSquaresProblem) -> None:
    phi = nothing(bent)
    phi[3] = 50.0
    found = minimise(bent, phi, 3, 1e-3)
    assert found.cost == torch.inf and not found.converged
    assert torch.equal(found.phi, phi)


def test_with_a_loose_tolerance_a_good_prediction_needs_no_second_jacobian(
    linear: LeastSquaresProblem, bent: LeastSquaresProblem
) -> None:
    loose, tight = (minimise(linear, nothing(linear), 5, tol) for tol in (LOOSE, LOOSE / 2))
    assert (loose.jacobians, tight.jacobians) == (1, 2)
    assert loose.converged and loose.cost == pytest.approx(tight.cost, rel=1e-9)
    far = nothing(bent)
    far[:2] = torch.tensor([5.0, -5.0])
    found = minimise(bent, far, 15, LOOSE)
    assert found.converged and found.jacobians > 1
    assert found.cost < (1 + LOOSE) * minimise(bent, far, 15, 1e-8).cost


def test_a_fit_that_cannot_reach_its_bound_is_given_up(bent: LeastSquaresProblem) -> None:
    far = nothing(bent)
    far[:2] = torch.tensor([5.0, -5.0])
    whole = minimise(bent, far, 15, 1e-8)
    reached = minimise(bent, far, 15, 1e-8, bound=whole.cost + 1)
    assert torch.equal(reached.phi, whole.phi)
    given_up = minimise(bent, far, 15, 1e-8, bound=whole.cost / 2)
    assert not given_up.converged or given_up.jacobians <= whole.jacobians
    assert given_up.cost > whole.cost / 2
    assert minimise(bent, whole.phi, 15, 0.0, bound=whole.cost / 2).jacobians == 1
