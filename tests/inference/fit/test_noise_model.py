"""Whitening is a root of the inverse covariance, and estimates find the true values."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest
import torch
from torch import Tensor

from dashred.inference.fit.noise_model import LARGEST_CORRELATION, NoiseModel

RHO = 0.6


def model(std: list[float], rho: float, seen: Tensor) -> NoiseModel:
    sizes = torch.tensor(std, dtype=torch.float64)
    return NoiseModel(sizes, torch.full_like(sizes, rho), seen)


def everywhere(samples: int, sensors: int) -> Tensor:
    return torch.ones(samples, sensors, dtype=torch.bool)


def white(*shape: int, seed: int = 0) -> Tensor:
    generator = torch.Generator().manual_seed(seed)
    return torch.randn(*shape, generator=generator, dtype=torch.float64)


def coloured(samples: int, std: list[float], rho: float, seed: int = 0) -> Tensor:
    """Draw stationary noise by its recursion."""
    drawn = white(samples, len(std), seed=seed)
    rows = [drawn[0]]
    for shock in drawn[1:]:
        rows.append(rho * rows[-1] + math.sqrt(1 - rho**2) * shock)
    return torch.stack(rows) * torch.tensor(std, dtype=torch.float64)


def covariance(seen: Tensor, std: float, rho: float) -> Tensor:
    """Return σ² ρ^|i-j| of one sensor; samples on both sides of a gap are independent."""
    pieces = torch.cumsum(~seen, dim=0)
    steps = torch.arange(len(seen))
    together = pieces[:, None] == pieces[None, :]
    found = std**2 * rho ** (steps[:, None] - steps[None, :]).abs().double()
    return torch.where(together, found, 0.0)[seen][:, seen]


def whitening(noise: NoiseModel, sensor: int) -> Tensor:
    """Return the matrix of the whitening of one sensor, column by column."""
    samples, sensors = noise.available.shape
    units = torch.zeros(samples, samples, sensors, dtype=torch.float64)
    units[:, :, sensor] = torch.eye(samples)
    found = noise.whiten(units)
    assert not found[..., [s for s in range(sensors) if s != sensor]].any()
    return found[..., sensor].T


@pytest.mark.parametrize("rho", [0.0, RHO])
@pytest.mark.parametrize("gap", [False, True])
def test_whitening_is_a_root_of_the_inverse_covariance(rho: float, gap: bool) -> None:
    seen = everywhere(9, 2)
    if gap:
        seen[[3, 6, 7], 0] = False
    noise = model([0.3, 2.0], rho, seen)
    for sensor, std in enumerate((0.3, 2.0)):
        known = seen[:, sensor]
        matrix, dense = whitening(noise, sensor), covariance(known, std, rho)
        assert not matrix[:, ~known].any() and not matrix[~known].any()
        root = matrix[known][:, known]
        torch.testing.assert_close(root.T @ root, torch.linalg.inv(dense))
        assert float(root.logdet()) == pytest.approx(-float(dense.logdet()) / 2)


def test_the_quadratic_form_is_that_of_the_dense_covariance() -> None:
    noise = model([0.3, 2.0], RHO, everywhere(30, 2))
    values = white(30, 2)
    expected = 0.0
    for sensor, std in enumerate((0.3, 2.0)):
        dense, column = covariance(everywhere(30, 1)[:, 0], std, RHO), values[:, sensor]
        expected += float(column @ torch.linalg.solve(dense, column))
    assert float(noise.whiten(values).square().sum()) == pytest.approx(expected, rel=1e-10)


def test_whitened_noise_is_white_and_of_unit_variance() -> None:
    noise = model([0.3, 2.0], RHO, everywhere(20000, 2))
    found = noise.whiten(coloured(20000, [0.3, 2.0], RHO))
    torch.testing.assert_close(found.var(dim=0), torch.ones(2).double(), rtol=0.03, atol=0)
    for lag in (1, 2, 5):
        assert float((found[lag:] * found[:-lag]).mean().abs()) < 0.02
    assert float((found[:, 0] * found[:, 1]).mean().abs()) < 0.02


def test_missing_values_do_not_count_and_batches_are_rows() -> None:
    seen = everywhere(6, 2)
    seen[2, 1] = False
    noise = model([0.5, 0.5], RHO, seen)
    values = white(3, 6, 2)
    values[:, 2, 1] = torch.nan
    found = noise.whiten(values)
    assert torch.isfinite(found).all() and not found[:, 2, 1].any()
    for row, alone in zip(found, values, strict=True):
        torch.testing.assert_close(row, noise.whiten(alone))
    assert noise.count == 11 and noise.truncate(3).count == 5
    torch.testing.assert_close(noise.truncate(3).whiten(values[:, :3]), found[:, :3])


def test_correlation_reduces_the_effective_count() -> None:
    noise = model([1.0], 0.5, everywhere(300, 1))
    assert noise.effective_count == pytest.approx(100.0)
    # The variance of a long mean is that of the effective number of independent samples.
    total = float(covariance(noise.available[:, 0], 1.0, 0.5).sum()) / 300**2
    assert 1 / total == pytest.approx(noise.effective_count, rel=0.01)
    assert model([1.0], 0.0, noise.available).effective_count == 300


@pytest.mark.parametrize("rho", [0.0, RHO, 0.9])
def test_estimates_find_sigma_and_rho(rho: float) -> None:
    residuals = coloured(6000, [0.1, 0.2, 5.0], rho)
    residuals[100:180, 1] = torch.nan
    seen = ~residuals.isnan()
    # The level of each group is wrong; the ratio within the first is right.
    found = model([0.3, 0.6, 1.0], 0.0, seen).estimate(residuals, ["u", "u", "v"], 0)
    expected = torch.tensor([0.1, 0.2, 5.0], dtype=torch.float64)
    tolerance = 4 * math.sqrt((1 + rho**2) / (1 - rho**2) / 12000)
    torch.testing.assert_close(found.std[:2], expected[:2], rtol=tolerance, atol=0)
    torch.testing.assert_close(found.std[2:], expected[2:], rtol=1.5 * tolerance, atol=0)
    assert float(found.std[1] / found.std[0]) == pytest.approx(2.0, rel=1e-12)
    for group, samples in ((slice(0, 2), 12000), (slice(2, 3), 6000)):
        error = 4 * math.sqrt((1 - rho**2) / samples) + 1e-9
        torch.testing.assert_close(
            found.correlation[group],
            torch.full_like(found.correlation[group], rho),
            rtol=0,
            atol=error,
        )


def test_the_estimate_corrects_for_fitted_parameters() -> None:
    residuals = white(400, 2)
    noise = model([1.0, 1.0], 0.0, everywhere(400, 2))
    plain, spent = (noise.estimate(residuals, ["u", "u"], k) for k in (0.0, 200.0))
    torch.testing.assert_close(plain.std.square(), residuals.square().mean().expand(2))
    torch.testing.assert_close(spent.std.square(), plain.std.square() / 0.75)
    everything = noise.estimate(residuals, ["u", "u"], 800.0)
    torch.testing.assert_close(everything.std.square(), plain.std.square() / 0.1)


def test_a_correlation_must_be_significant_and_positive() -> None:
    turns = torch.tensor([1.0, -1.0]).double().repeat(100)[:, None]
    noise = model([1.0], 0.5, everywhere(200, 1))
    assert noise.estimate(turns, ["u"], 0).correlation.tolist() == [0.0]
    drift = torch.ones(200, 1, dtype=torch.float64)
    assert noise.estimate(drift, ["u"], 0).correlation.tolist() == [LARGEST_CORRELATION]
    few = coloured(20, [1.0], 0.4)
    assert model([1.0], 0.0, everywhere(20, 1)).estimate(few, ["u"], 0).correlation.tolist() == [
        0.0
    ]
    apart = everywhere(200, 1)
    apart[::2] = False
    assert model([1.0], 0.0, apart).estimate(drift, ["u"], 0).correlation.tolist() == [0.0]


def test_quantities_have_correlations_of_their_own() -> None:
    residuals = torch.cat([coloured(3000, [1.0], 0.8), coloured(3000, [1.0], 0.0, seed=1)], dim=1)
    noise = model([1.0, 1.0], 0.0, everywhere(3000, 2))
    found = noise.estimate(residuals, ["theta", "omega"], 0)
    assert found.correlation.tolist() == [pytest.approx(0.8, abs=0.05), 0.0]
    assert found.effective_count == pytest.approx(3000 * (0.2 / 1.8 + 1), rel=0.03)
    together = noise.estimate(residuals, ["u", "u"], 0).correlation
    assert together.tolist() == [pytest.approx(0.4, abs=0.05)] * 2
    white_again = found.whiten(residuals)
    assert float((white_again[1:] * white_again[:-1]).mean(dim=0).abs().max()) < 0.06


def test_the_noise_of_a_part_is_that_of_the_whole_record() -> None:
    """Noise as a share of the reading: every sample has its own σ."""
    values = white(20, 1).abs() + 1
    whole = NoiseModel(torch.ones(1).double(), torch.zeros(1).double(), everywhere(20, 1), values)
    part = whole.truncate(6)
    noise = part.estimate(0.5 * values[:6] * white(6, 1, seed=1), ["u"], 0)
    assert float(noise.std) < 1
    found = noise.over(whole)
    torch.testing.assert_close(found.whiten(values), torch.ones(20, 1).double() / noise.std)


def test_scaling_changes_only_sigma() -> None:
    noise = model([0.5, 2.0], RHO, everywhere(5, 2))
    values = white(5, 2)
    torch.testing.assert_close(noise.scaled(4.0).whiten(values), noise.whiten(values) / 4)


def test_groups_without_samples_keep_their_sigma() -> None:
    seen = torch.ones((50, 2), dtype=torch.bool)
    seen[:, 1] = False
    before = NoiseModel(
        torch.tensor([0.1, 0.3], dtype=torch.float64), torch.zeros(2).double(), seen
    )
    residuals = 0.2 * torch.randn((50, 2), generator=torch.Generator().manual_seed(0)).double()
    after = before.estimate(residuals, ["q", "p"], 2)
    assert float(after.std[0]) == pytest.approx(0.2, rel=0.3)
    assert float(after.std[1]) == 0.3


@pytest.mark.parametrize("size", [1e20, 1e200, math.inf, math.nan])
def test_residuals_of_a_run_that_blows_up_are_no_noise(size: float) -> None:
    noise = model([0.3, 2.0], RHO, everywhere(50, 2))
    residuals = white(50, 2)
    residuals[:, 1] *= size
    found = noise.estimate(residuals, ["u", "v"], 0)
    assert found.std[1] == 2.0 and found.correlation[1] == 0.0
    assert found.std[0] == pytest.approx(1.0, rel=0.3)


def test_readings_without_noise_have_the_least_one() -> None:
    least = torch.tensor([1e-3, 2e-3], dtype=torch.float64)
    begun = replace(model([1.0, 2.0], 0.0, everywhere(100, 2)), least_std=least)
    exact = begun.part(slice(80)).estimate(1e-9 * white(80, 2), ["u", "u"], 3.0)
    torch.testing.assert_close(exact.std, least)
    noisy = begun.estimate(0.1 * white(100, 2), ["u", "v"], 3.0)
    assert (noisy.std > 0.05).all()
