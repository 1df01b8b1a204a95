"""The ensemble Kalman filter and optimal interpolation, against what is known in closed form."""

from __future__ import annotations

import pytest
import torch
from torch import Tensor

from dashred.data.sensors import Sensor
from dashred.evaluation.baselines import kalman_filter, optimal_interpolation
from dashred.evaluation.baselines.kalman_filter import filter_augmented, filter_state
from dashred.evaluation.baselines.optimal_interpolation import Taper, best_linear
from dashred.inference.initial_state.linear_estimate import linear_estimate
from dashred.physics.grids.grid import Axis, Grid
from dashred.physics.runs.ensemble import term_scales
from dashred.physics.solvers.simulate import simulate
from dashred.pipeline.problem import Problem


def kalman(problem: Problem, starts: Tensor) -> Tensor:
    """Return the Kalman filter's means, ``(time, 2)``, from the mean and covariance of starts."""
    fit = problem.split.fit
    times, sigma = problem.times[: len(fit.times)], float(problem.noise_of(fit.names)[0])
    basis = torch.eye(2, dtype=torch.float64)
    mean, covariance = starts.mean(dim=0), torch.cov(starts.T)
    found = []
    for i, value in enumerate(fit.values[:, 0].tolist()):
        if i:
            step = simulate(problem.ensemble_system, basis, times[i - 1 : i + 1])[:, -1].T
            mean, covariance = step @ mean, step @ covariance @ step.T
        gain = covariance[:, 0] / (covariance[0, 0] + sigma**2)
        mean = mean + gain * (value - mean[0])
        covariance = covariance - torch.outer(gain, covariance[0])
        found.append(mean)
    return torch.stack(found)


def test_of_a_linear_system_it_is_the_kalman_filter(swing, monkeypatch) -> None:
    monkeypatch.setattr(kalman_filter, "INFLATIONS", (1.0,))
    problem, _, ensemble = swing["null"]
    found = filter_state(problem, ensemble)
    exact = kalman(problem, ensemble.states[:, 0])
    torch.testing.assert_close(found.states, exact, rtol=0, atol=1e-8)


def test_the_augmented_filter_learns_the_damping_that_is_hidden(swing) -> None:
    problem, nominal, ensemble = swing["a"]
    found = filter_augmented(problem, ensemble, nominal.states)
    assert found.terms is not None
    law = {(each["equation"], each["term"]): each["coefficient"] for each in found.terms}
    # Most of it: a coefficient times a state is not linear, and the filter only is of what is.
    assert -0.13 < law["p", "p"] < -0.05
    state = filter_state(problem, ensemble)
    fit = torch.from_numpy(problem.split.fit.values)[60:, 0]
    errors = [float((e.states[60:, 0] - fit).square().mean().sqrt()) for e in (found, state)]
    assert errors[0] <= 1.05 * errors[1]


def test_the_augmented_filter_makes_no_law_of_nothing(swing) -> None:
    problem, nominal, ensemble = swing["null"]
    found = filter_augmented(problem, ensemble, nominal.states)
    assert found.terms == []


def test_every_member_carries_every_term(swing) -> None:
    problem, nominal, _ = swing["a"]
    drawn = kalman_filter._coefficients(problem, nominal.states, 4000, 0.2)
    assert bool((drawn != 0).all())
    scales = term_scales(problem.system, problem.library, nominal.states, 0.0)
    torch.testing.assert_close(drawn.std(dim=0), 0.2 * scales, rtol=0.05, atol=0)
    apart = torch.corrcoef(drawn.T) - torch.eye(len(scales), dtype=torch.float64)
    assert float(apart.abs().max()) < 0.08


def test_interpolation_is_the_best_linear_unbiased_estimate() -> None:
    """Of a known Gaussian, from a sample whose mean and covariance are exactly its own."""
    generator = torch.Generator().manual_seed(1)
    root = torch.randn((6, 6), generator=generator, dtype=torch.float64)
    mean = torch.arange(6, dtype=torch.float64)
    signs = torch.cat([torch.eye(6), -torch.eye(6)]).double() * (11 / 2) ** 0.5
    sample = mean + signs @ root.T
    exact_c = root @ root.T
    torch.testing.assert_close(torch.cov(sample.T), exact_c)
    read = torch.zeros((2, 6), dtype=torch.float64)
    read[0, 1], read[1, 4] = 1.0, 1.0
    noise = torch.tensor([0.3, 0.5], dtype=torch.float64)
    values = torch.tensor([2.0, 1.0], dtype=torch.float64)
    covariance = read @ exact_c @ read.T + noise.square().diag()
    departure = values - read @ mean
    exact = mean + exact_c @ read.T @ torch.linalg.inv(covariance) @ departure
    grid = Grid((Axis("x", 6.0, 6),))
    sensors = [Sensor("a", "u", (1.0,)), Sensor("b", "u", (4.0,))]
    taper = Taper.of(grid, sensors, torch.inf)
    found, unlikely = best_linear(sample[:, None], sample @ read.T, values, noise, taper)
    torch.testing.assert_close(found[0], exact)
    density = torch.distributions.MultivariateNormal(read @ mean, covariance).log_prob(values)
    rest = torch.log(torch.tensor(2 * torch.pi, dtype=torch.float64))
    assert unlikely == pytest.approx(-float(density + rest), rel=1e-10)
    whole = linear_estimate(sample[:, None], (sample @ read.T)[:, None], values[None], noise)
    torch.testing.assert_close(found, whole.mean)
    gap = torch.tensor([2.0, torch.nan], dtype=torch.float64)
    only, _ = best_linear(sample[:, None], sample @ read.T, gap, noise, taper)
    alone = exact_c[:, 1] / covariance[0, 0] * (2.0 - mean[1])
    torch.testing.assert_close(only[0], mean + alone)


def test_a_taper_mends_interpolation_from_a_small_sample() -> None:
    """Of a field of short correlation few members give far ones by chance."""
    grid = Grid((Axis("x", 10.0, 60),))
    x = grid.coordinates["x"]
    apart = (x[:, None] - x + 5).remainder(10) - 5
    root = torch.linalg.cholesky(torch.exp(-(apart**2)) + 1e-9 * torch.eye(60))
    generator = torch.Generator().manual_seed(2)
    sensors = [Sensor(f"s{i}", "u", (float(x[i]),)) for i in range(0, 60, 6)]
    at, noise = list(range(0, 60, 6)), torch.full((10,), 0.1, dtype=torch.float64)
    tapers = [Taper.of(grid, sensors, radius) for radius in (torch.inf, 1.5)]
    errors, surprises = torch.zeros(2), torch.zeros(2)
    for _ in range(20):
        draws = torch.randn((13, 60), generator=generator, dtype=torch.float64) @ root.T
        truth, sample = draws[0], draws[1:]
        values = truth[at] + noise * torch.randn(10, generator=generator)
        for j, taper in enumerate(tapers):
            found, unlikely = best_linear(sample[:, None], sample[:, at], values, noise, taper)
            errors[j] += float((found[0] - truth).square().mean())
            surprises[j] += unlikely
    assert errors[1] < 0.6 * errors[0]
    assert surprises[1] < surprises[0]


def test_interpolation_of_a_recording_chooses_its_radius_and_says_so(swing) -> None:
    problem, _, ensemble = swing["null"]
    found = optimal_interpolation.optimal_interpolation(problem, ensemble)
    assert found.note.endswith("members, not localised")
    fit, noise = problem.split.fit, problem.noise_of(problem.split.fit.names)
    for i in (0, 40):
        values = torch.from_numpy(fit.values)[i, None]
        states = ensemble.states[:, i]
        exact = linear_estimate(states, states[:, None, :1], values, noise).mean
        torch.testing.assert_close(found.states[i], exact)
