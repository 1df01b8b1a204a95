"""The error bars of a law: a block of the inverse Hessian, calibrated over many draws."""

from __future__ import annotations

import dataclasses
import math

import pytest
import torch
from torch import Tensor

from dashred.inference.fit.fitted_law import build_selected_law
from dashred.inference.fit.law import Law
from dashred.inference.fit.least_squares import LeastSquaresProblem
from dashred.inference.fit.levenberg_marquardt import minimise
from tests import laws
from tests.swing import DRIVES, TIMES, Swing, noisy, ridge

SIGMA, PRIOR = 0.2, (0.5, 0.1, 1.0, 0.3)
Z, XI = (0.8, -0.6), (0.2, 0.05, -0.3, 0.1)
DRAWS = 30


def fitted(objective: LeastSquaresProblem, members: tuple[int, ...]) -> tuple[Law, Tensor]:
    """Return the law at the minimum, from normal equations of all candidates, and φ."""
    phi, cost, _ = ridge(objective, members)
    normal = objective.linearise(phi)
    [readings] = objective.forward_model.readings(*objective.split(phi[None]))
    return build_selected_law(objective, normal, phi, members, readings, cost), phi


@pytest.fixture(scope="module")
def linear(swing: Swing) -> LeastSquaresProblem:
    """A problem that is linear in all unknowns."""
    recorded = noisy(swing.clean(Z, DRIVES, XI), SIGMA, seed=0)
    recorded[3, 0] = torch.nan
    return swing.objective(DRIVES, recorded, SIGMA, PRIOR)


@pytest.mark.parametrize("members", [(0, 1, 2, 3), (1, 3), (2,)])
def test_the_covariance_is_the_block_of_the_inverse_hessian(
    linear: LeastSquaresProblem, members: tuple[int, ...]
) -> None:
    law, phi = fitted(linear, members)
    _, cost, covariance = ridge(linear, members)
    torch.testing.assert_close(law.covariance, covariance[2:, 2:], rtol=1e-6, atol=1e-12)
    torch.testing.assert_close(law.std, covariance.diagonal()[2:].sqrt(), rtol=1e-6, atol=0)
    assert [found.name for found in law.candidates] == [DRIVES[j] for j in members]
    assert torch.equal(law.coefficients, phi[[2 + j for j in members]])
    assert law.score == cost
    # A known start gives a smaller uncertainty.
    sharp = torch.linalg.inv(torch.linalg.inv(covariance)[2:, 2:])
    assert (law.std >= sharp.diagonal().sqrt() * (1 - 1e-9)).all()


def test_half_the_curvature_of_f_is_the_inverse_covariance(linear: LeastSquaresProblem) -> None:
    """By differences of F, minimised over the start for every ξ."""
    law, _ = fitted(linear, (0, 1, 2, 3))
    _, best, _ = ridge(linear, range(4))

    def profile(xi: Tensor) -> float:
        recorded = linear.recorded - _driven(linear, xi)
        fixed = dataclasses.replace(linear, recorded=recorded)
        return ridge(fixed, ())[1] + float((xi / linear.prior_std).square().sum())

    assert profile(law.coefficients) == pytest.approx(best, rel=1e-8)
    for j, std in enumerate(law.std.tolist()):
        step = law.covariance[j] / std  # the others at their conditional minimum
        for sign in (1, -1):
            assert profile(law.coefficients + sign * step) == pytest.approx(best + 1, rel=1e-6)


def _driven(objective: LeastSquaresProblem, xi: Tensor) -> Tensor:
    """Return the effect of coefficients on the readings."""
    z = torch.zeros((2, objective.modes), dtype=torch.float64)
    with_xi, without = objective.forward_model.readings(z, torch.stack([xi, 0 * xi]))
    return with_xi - without


def test_error_bars_are_calibrated_over_draws(swing: Swing) -> None:
    """Truth and noise are drawn from the distributions that F assumes."""
    generator = torch.Generator().manual_seed(3)
    prior = torch.tensor(PRIOR, dtype=torch.float64)
    scores, inside, chi2 = [], 0, []
    for seed in range(DRAWS):
        z = torch.randn(2, generator=generator, dtype=torch.float64)
        xi = prior * torch.randn(4, generator=generator, dtype=torch.float64)
        recorded = noisy(swing.clean(z.tolist(), DRIVES, xi.tolist()), SIGMA, 100 + seed)
        objective = swing.objective(DRIVES, recorded, SIGMA, PRIOR)
        found = minimise(objective, torch.zeros(6, dtype=torch.float64), 1, 1e-6)
        normal = objective.linearise(found.phi)
        law = build_selected_law(
            objective, normal, found.phi, (0, 1, 2, 3), found.readings, found.cost
        )
        scores.append((law.coefficients - xi) / law.std)
        chi2.append(law.chi2)
        bounds = [law.interval(j) for j in range(4)]
        inside += sum(a < v < b for (a, b), v in zip(bounds, xi.tolist(), strict=True))
    z_scores = torch.stack(scores)
    assert 0.8 < float(z_scores.square().mean().sqrt()) < 1.25
    assert (z_scores.square().mean(dim=0).sqrt() < 1.5).all()
    assert 0.88 < inside / (4 * DRAWS) <= 1.0
    # Six unknowns use at most six of 162 degrees of freedom.
    assert 156 / 162 - 0.06 < sum(chi2) / DRAWS < 1.05


def test_residuals_and_chi2_leave_missing_samples_out(linear: LeastSquaresProblem) -> None:
    law, phi = fitted(linear, (0, 1, 2, 3))
    assert bool(law.residuals[3, 0].isnan()) and int(law.residuals.isnan().sum()) == 1
    [readings] = linear.forward_model.readings(*linear.split(phi[None]))
    known = ~linear.recorded.isnan()
    torch.testing.assert_close(law.residuals[known], (readings - linear.recorded)[known])
    assert law.chi2 == pytest.approx(float((law.residuals[known] / SIGMA).square().mean()))
    expected = linear.forward_model.start.start(phi[None, :2])[0]
    assert torch.equal(law.start, expected)


def test_the_law_reproduces_its_fitted_readings(linear: LeastSquaresProblem, swing: Swing) -> None:
    from dashred.physics.solvers.simulate import simulate

    law, phi = fitted(linear, (0, 3))
    run = simulate(swing.system, law.start, TIMES, law.forcing())
    [readings] = linear.forward_model.readings(*linear.split(phi[None]))
    torch.testing.assert_close(swing.operator(run)[0], readings, rtol=1e-10, atol=1e-10)


def test_the_text_of_the_empty_law(linear: LeastSquaresProblem) -> None:
    law, _ = fitted(linear, ())
    assert law.forcing() is None and str(law) == "nothing"
    assert law.covariance.shape == (0, 0) and law.std.shape == (0,)


def test_intervals_hold_95_percent() -> None:
    law = laws.law(coefficients := (), ())
    assert coefficients == () and len(law.coefficients) == 0
    one = dataclasses.replace(
        law,
        coefficients=torch.tensor([2.0], dtype=torch.float64),
        covariance=torch.tensor([[0.25]], dtype=torch.float64),
    )
    low, high = one.interval(0)
    assert (low + high) / 2 == pytest.approx(2.0)
    assert math.erf((high - 2.0) / 0.5 / math.sqrt(2)) == pytest.approx(0.95, abs=1e-6)
