"""The free forcing: its evidence is Gaussian, and it is large if something is missing."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest
import torch

from dashred.inference.fit.least_squares import NormalEquations
from dashred.inference.forward.forcing_block import ForcingBlock
from dashred.inference.hypotheses import free_forcing
from dashred.inference.hypotheses.forcing_levels import evidence
from dashred.inference.hypotheses.free_forcing import (
    FreeForcing,
    fit_forcing_block,
    fit_free_forcing,
)
from dashred.inference.hypotheses.result import MIN_FORCING_GAIN
from dashred.physics.forcing_basis import ForcingBasis
from tests.waves import TIMES, Waves, fitted

SIGMA = 0.02


def test_evidence_is_the_density_of_the_recording() -> None:
    """``-2 ln N(y; 0, J P⁻¹ Jᵀ + 1)``, up to a constant that is the same for all models."""
    generator = torch.Generator().manual_seed(0)
    jacobian = torch.randn((12, 5), generator=generator).double()
    precision = torch.rand(5, generator=generator).double() + 0.5
    y = torch.randn(12, generator=generator).double()
    phi = torch.zeros(5, dtype=torch.float64)
    normal = NormalEquations(jacobian, precision, phi, -y)

    def exact(index: list[int]) -> float:
        columns = jacobian[:, index]
        covariance = torch.eye(12) + columns @ torch.diag(1 / precision[index]) @ columns.T
        return float(y @ torch.linalg.solve(covariance, y) + torch.logdet(covariance))

    for index in ([0, 1, 2, 3, 4], [1, 3], [2]):
        assert abs(evidence(normal, index) - exact(index)) < 1e-9


def test_a_forcing_gains_nothing_if_nothing_is_missing(waves: Waves) -> None:
    objective = waves.objective(waves.recorded(SIGMA, 6), SIGMA)
    forced, gain = fit_free_forcing(objective, fitted(objective), waves.size)
    assert gain < MIN_FORCING_GAIN and float(forced.amplitudes.abs().max()) < 0.05 * float(
        waves.size[0]
    )


def test_a_forcing_fits_the_recording_and_identifies_the_equation(waves: Waves) -> None:
    [hidden] = waves.candidates(["v: 1"])
    recorded = waves.recorded(SIGMA, 7, [(hidden, 0.2)])
    objective = waves.objective(recorded, SIGMA)
    phi = fitted(objective)
    [before], _ = objective.values(phi[None])
    forced, gain = fit_free_forcing(objective, phi, waves.size)
    assert gain > 100 and forced.cost < 1.2 * recorded.numel() < 0.3 * float(before)
    block = ForcingBlock(ForcingBasis.over(waves.system, TIMES, 6, 7), waves.size)
    alone = {
        equation: fit_forcing_block(objective, phi, block, [equation])[0].evidence
        for equation in range(2)
    }
    assert alone[1] < alone[0]


def test_a_lost_forcing_is_refitted_over_a_growing_horizon(
    waves: Waves, monkeypatch: pytest.MonkeyPatch
) -> None:
    [hidden] = waves.candidates(["v: 1"])
    recorded = waves.recorded(SIGMA, 7, [(hidden, 0.2)])
    objective = waves.objective(recorded, SIGMA)
    block = ForcingBlock(ForcingBasis.over(waves.system, TIMES, 6, 7), waves.size)
    # One step does not lead back from such a distant initial state.
    monkeypatch.setattr(free_forcing, "ROUNDS", 1)
    monkeypatch.setattr(free_forcing, "STEPS", 1)
    distant = torch.full((objective.modes,), 6.0, dtype=torch.float64)

    def cost() -> float:
        return fit_forcing_block(objective, distant, block, [0, 1])[0].cost

    assert cost() < 1.2 * recorded.numel()
    monkeypatch.setattr(free_forcing, "MAX_NOISE_RATIO", math.inf)
    assert cost() > 10 * recorded.numel()


def test_one_faulty_sensor_is_no_lost_trajectory_but_several_are(
    waves: Waves,
) -> None:
    objective = waves.objective(waves.recorded(SIGMA, 6), SIGMA)
    forced, _ = fit_free_forcing(objective, fitted(objective), waves.size)
    shape = objective.recorded.shape

    def left(sensors: int, first: int) -> FreeForcing:
        residuals = torch.ones(shape, dtype=torch.float64)
        residuals[first:, :sensors] = 15.0
        return replace(forced, normal=replace(forced.normal, residuals=residuals.flatten()))

    assert not free_forcing._has_lost_recording(left(1, 0))
    assert free_forcing._has_lost_recording(left(shape[1] // 3, shape[0] * 4 // 5))


def test_evidence_is_finite_if_columns_exceed_the_prior() -> None:
    """A trajectory that is about to blow up has finite but huge columns, with rounding errors."""
    generator = torch.Generator().manual_seed(0)
    jacobian = 1e14 * torch.randn((400, 3), generator=generator, dtype=torch.float64)
    jacobian = jacobian @ torch.randn((3, 60), generator=generator, dtype=torch.float64)
    residuals = torch.randn(400, generator=generator, dtype=torch.float64)
    ones = torch.ones(60, dtype=torch.float64)
    normal = NormalEquations(jacobian, ones, torch.zeros(60, dtype=torch.float64), residuals, True)
    assert math.isfinite(evidence(normal, range(60)))
