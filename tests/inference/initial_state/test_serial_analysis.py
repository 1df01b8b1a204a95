"""The compiled analysis is that of Kalman with the covariances of the sample."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import multivariate_normal

from dashred.inference.initial_state.serial_analysis import analyse, inflate

MEMBERS, SENSORS, STATE = 12, 3, 4
NOISE = np.array([0.5, 0.3, 0.8])
EVERYWHERE = np.ones((SENSORS, SENSORS + STATE))
NO_LIMITS = np.full(SENSORS, np.inf)


def joint(seed: int = 0) -> np.ndarray:
    """Return readings and states of members; the readings are linear in the state."""
    rng = np.random.default_rng(seed)
    states = rng.standard_normal((MEMBERS, STATE)) @ rng.standard_normal((STATE, STATE))
    return np.concatenate([states @ rng.standard_normal((STATE, SENSORS)), states], axis=1)


def test_the_update_and_the_density_are_those_of_kalman() -> None:
    before, values = joint(), np.array([0.4, -1.0, 2.0])
    mean, covariance = before.mean(axis=0), np.cov(before.T)
    readings = covariance[:SENSORS, :SENSORS] + np.diag(NOISE**2)
    gain = covariance[:, :SENSORS] @ np.linalg.inv(readings)
    after = before.copy()
    innovation, std, serial, density = analyse(after, values, NOISE, EVERYWHERE, NO_LIMITS)
    assert innovation == pytest.approx(values - mean[:SENSORS])
    assert std == pytest.approx(np.sqrt(np.diag(readings)))
    assert after.mean(axis=0) == pytest.approx(mean + gain @ innovation)
    np.testing.assert_allclose(np.cov(after.T), covariance - gain @ covariance[:SENSORS], atol=1e-9)
    assert serial @ serial == pytest.approx(innovation @ np.linalg.solve(readings, innovation))
    exact = multivariate_normal(np.zeros(SENSORS), readings).logpdf(innovation)
    assert density == pytest.approx(exact + SENSORS / 2 * np.log(2 * np.pi))


@pytest.mark.parametrize("is_missing", [True, False])
def test_a_reading_that_is_missing_or_left_out_changes_nothing(is_missing: bool) -> None:
    before, values, limits = joint(), np.array([0.4, -1.0, 2.0]), NO_LIMITS.copy()
    if is_missing:
        values[1] = np.nan
    else:
        limits[1] = 0.0
    without, full = before.copy(), before.copy()
    innovation, _, serial, _ = analyse(full, values, NOISE, EVERYWHERE, limits)
    kept = [0, 2]
    columns = [0, 2, 3, 4, 5, 6]
    part = np.ascontiguousarray(without[:, columns])
    tapers, others = np.ones((2, len(columns))), np.full(2, np.inf)
    analyse(part, values[kept], NOISE[kept], tapers, others)
    np.testing.assert_allclose(full[:, columns], part)
    assert np.isnan(serial[1]) and np.isnan(innovation[1]) == is_missing


def test_a_taper_of_zero_keeps_what_is_far_away() -> None:
    before = joint()
    tapers, after = EVERYWHERE.copy(), before.copy()
    tapers[:, -1] = 0.0
    analyse(after, np.array([0.4, -1.0, 2.0]), NOISE, tapers, NO_LIMITS)
    np.testing.assert_allclose(after[:, -1], before[:, -1])


def test_inflation_keeps_the_mean() -> None:
    before, random = joint(), joint(seed=1)
    after = before.copy()
    inflate(after, 1.5, random)
    expected = 1.5 * (before - before.mean(axis=0)) + random - random.mean(axis=0)
    np.testing.assert_allclose(after, before.mean(axis=0) + expected)
