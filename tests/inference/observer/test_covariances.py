"""Covariances of errors give the equations of the Kalman filter."""

from __future__ import annotations

import numpy as np

from dashred.inference.observer.covariances import Covariances

SENSORS, POINTS, NOISE = 3, 5, np.array([0.3, 0.5, 0.2])
EVERYWHERE = np.ones((SENSORS, SENSORS + 1 + POINTS))


def drawn(seed: int, members: int = 40) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return errors, the readout, ``(field*point, quantity)``, and what it reads of them."""
    rng = np.random.default_rng(seed)
    errors = rng.standard_normal((members, POINTS)) @ rng.standard_normal((POINTS, POINTS))
    readout = rng.standard_normal((POINTS, SENSORS + 1))
    return errors, readout, errors @ readout


def test_gain_and_variances_are_those_of_the_kalman_filter() -> None:
    errors, readout, read = drawn(0)
    found = Covariances.of_errors(errors, read, EVERYWHERE)
    known = np.array([True, False, True])
    p, h = errors.T @ errors / len(errors), readout[:, :SENSORS][:, known].T
    gain = p @ h.T @ np.linalg.inv(h @ p @ h.T + np.diag(NOISE[known] ** 2))
    innovations, analysed = np.eye(known.sum()), np.diag(p - gain @ h @ p)
    for each in (known, np.flatnonzero(known)):
        update = found.update(NOISE, each)
        np.testing.assert_allclose(update.corrections(innovations), gain.T, rtol=1e-9)
        np.testing.assert_allclose(update.variances(found.of_state), analysed, rtol=1e-6)
    np.testing.assert_allclose(found.of_quantities, np.square(read).mean(axis=0))


def test_without_a_reading_nothing_changes() -> None:
    found = Covariances.of_errors(*drawn(1)[::2], EVERYWHERE)
    update = found.update(NOISE, np.zeros(SENSORS, dtype=np.bool_))
    np.testing.assert_array_equal(update.corrections(np.empty((2, 0))), np.zeros((2, POINTS)))
    np.testing.assert_array_equal(update.variances(found.of_state), found.of_state)


def test_a_taper_of_zero_removes_a_covariance() -> None:
    tapers = EVERYWHERE.copy()
    tapers[1, SENSORS + 1 + 4] = tapers[0, 2] = 0.0
    found = Covariances.of_errors(*drawn(2)[::2], tapers)
    whole = Covariances.of_errors(*drawn(2)[::2], EVERYWHERE)
    assert found.across[1, 4] == 0.0 and found.between[0, 2] == 0.0
    np.testing.assert_array_equal(found.across[0], whole.across[0])


def test_a_blend_is_a_weighted_mean() -> None:
    one, other = (Covariances.of_errors(*drawn(seed)[::2], EVERYWHERE) for seed in (3, 4))
    for found, own, others in zip(one.blended(other, 0.25), one, other, strict=True):
        np.testing.assert_allclose(found, 0.75 * own + 0.25 * others)
