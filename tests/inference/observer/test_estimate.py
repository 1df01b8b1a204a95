"""Perturbations run with an estimate, and its readings make them smaller."""

from __future__ import annotations

import numpy as np
import pytest

from dashred.inference.observer.covariances import Covariances
from dashred.inference.observer.estimate import INFLATION, SHARE, TURNING, Estimate

POINTS, SENSORS = 4, 2
TAPERS = np.ones((SENSORS, SENSORS + POINTS))
READOUT = np.random.default_rng(1).standard_normal((POINTS, SENSORS))
NONE = np.zeros((3, POINTS))


def begun(perturbations: int = 3) -> Estimate:
    rng = np.random.default_rng(0)
    return Estimate(rng.standard_normal((1, POINTS)), rng.standard_normal((perturbations, POINTS)))


def of_simulations() -> Covariances:
    errors = np.random.default_rng(2).standard_normal((20, POINTS))
    return Covariances.of_errors(errors, errors @ READOUT, TAPERS)


def test_a_forecast_of_a_linear_simulator_maps_the_perturbations() -> None:
    estimate = begun()
    flow = np.random.default_rng(3).standard_normal((POINTS, POINTS))
    state, perturbations = estimate.state @ flow, estimate.perturbations @ flow
    estimate.arrive(estimate.states @ flow, NONE)
    np.testing.assert_allclose(estimate.state, state)
    np.testing.assert_allclose(estimate.perturbations, INFLATION * perturbations)


def test_the_mean_covariance_gives_way_to_that_of_the_perturbations() -> None:
    mean, estimate = of_simulations(), begun()
    first = estimate.covariances(mean, estimate.states @ READOUT, TAPERS)
    np.testing.assert_allclose(first.across, mean.across)
    for _ in range(int(20 * TURNING)):
        estimate.arrive(estimate.states, NONE)
        estimate.perturbations /= INFLATION
    later = estimate.covariances(mean, estimate.states @ READOUT, TAPERS)
    d = estimate.perturbations
    own = (d @ READOUT).T @ d / len(d)
    np.testing.assert_allclose(later.across, SHARE * mean.across + (1 - SHARE) * own, rtol=1e-6)


def test_readings_correct_the_state_and_half_of_the_perturbations() -> None:
    estimate = begun()
    update, innovation = of_simulations().update(np.ones(2), np.arange(2)), np.ones(SENSORS)
    gain = update.corrections(np.eye(SENSORS))
    state, d = estimate.state, estimate.perturbations
    estimate.correct(innovation, estimate.states @ READOUT, update)
    np.testing.assert_allclose(estimate.state, state + gain.sum(axis=0))
    np.testing.assert_allclose(estimate.perturbations, d - d @ READOUT @ gain / 2)


@pytest.mark.parametrize("steps", [0, 5])
def test_without_perturbations_the_covariances_are_the_mean_ones(steps: int) -> None:
    mean, estimate = of_simulations(), begun(0)
    for _ in range(steps):
        estimate.arrive(estimate.states, NONE[:0])
    assert estimate.covariances(mean, estimate.states @ READOUT, TAPERS) is mean
    update = mean.update(np.ones(2), np.arange(2))
    estimate.correct(np.ones(SENSORS), estimate.states @ READOUT, update)
    assert estimate.states.shape == (1, POINTS)


@pytest.mark.parametrize("value", [1e3, np.inf, np.nan])
def test_an_estimate_that_blows_up_is_far_from_all_states(value: float) -> None:
    estimate = begun()
    assert estimate.is_near(np.zeros(POINTS), 100.0)
    estimate.perturbations[0, 0] = value
    assert not estimate.is_near(np.zeros(POINTS), 100.0)
