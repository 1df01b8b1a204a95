"""The observer is the Kalman filter for linear systems, causal, and as uncertain as it says."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import torch
from numpy.typing import NDArray

from dashred.config import Source, build_config
from dashred.config.source_dict import source_from_dict
from dashred.core.budget import Deadline, OutOfTimeError
from dashred.data.observation_operator import ObservationOperator
from dashred.data.sensors import Sensor
from dashred.inference.observer.march import March
from dashred.inference.observer.observe import MODEL_ERRORS, observe
from dashred.inference.observer.observed_record import ObservedRecord
from dashred.physics.solvers.simulate import simulate
from dashred.physics.system import System

Array = NDArray[np.float64]

LINEAR = {"x": "p", "p": "-x - 0.1*p"}
VAN_DER_POL = {"x": "p", "p": "-x + (1 - x**2)*p"}
EVERY, SIGMA, SPREAD = 0.2, 0.1, 0.5
CENTRE = np.array([1.0, 0.0])
SEED = (0,)


def oscillator(equations: dict[str, str]) -> System:
    values: dict[str, Any] = {
        "system": {
            "title": "an oscillator",
            "fields": {"x": "place", "p": "momentum"},
            "equations": equations,
            "start": {"x": 1, "p": 0},
            "integrator": {"method": "rk4", "dt": 0.05},
        },
        "recording": {"twin": "a", "sensors": 1, "noise": 0, "duration": 12, "every": EVERY},
    }
    source = source_from_dict(values, "dict")
    config = build_config(source, Source({}, {"": "overrides"}), name="oscillator")
    return System(config.system, config.where)


def record(
    equations: dict[str, str], members: int, samples: int = 60, seed: int = 1, shift: float = 0.0
) -> tuple[ObservedRecord, Array]:
    """Return a recording of the first field with its simulations, and its state."""
    system, rng = oscillator(equations), np.random.default_rng(seed)
    starts = torch.from_numpy(CENTRE + SPREAD * rng.standard_normal((members + 1, 2)))
    times = EVERY * torch.arange(samples, dtype=torch.float64)
    paths = simulate(system, starts, times)
    operator = ObservationOperator((Sensor("place", "x"),), system)
    state = paths[-1].numpy()
    values = state[:, :1] + shift + SIGMA * rng.standard_normal((samples, 1))
    found = ObservedRecord(
        March(system),
        lambda sample: paths[:-1, sample].numpy(),
        times.numpy(),
        values,
        np.array([SIGMA]),
        operator,
        np.ones((1, 3)),
    )
    return found, state


def kalman_filter(values: Array) -> tuple[Array, Array]:
    """Return mean and standard deviation by the equations of the filter."""
    rate = torch.tensor([[0.0, 1.0], [-1.0, -0.1]], dtype=torch.float64)
    step = torch.linalg.matrix_exp(EVERY * rate).numpy()
    mean, covariance = CENTRE, SPREAD**2 * np.eye(2)
    means, stds = [], []
    for i, value in enumerate(values[:, 0]):
        if i:
            mean, covariance = step @ mean, step @ covariance @ step.T
        if not np.isnan(value):
            gain = covariance[:, 0] / (covariance[0, 0] + SIGMA**2)
            mean = mean + gain * (value - mean[0])
            covariance = covariance - np.outer(gain, covariance[0])
        means.append(mean)
        stds.append(np.sqrt(np.diag(covariance)))
    return np.array(means), np.array(stds)


def test_a_linear_system_gives_the_kalman_filter() -> None:
    given, _ = record(LINEAR, members=4000)
    given.values[20:25] = np.nan
    [found] = observe([given], SEED)
    mean, std = kalman_filter(given.values)
    assert found.model_error == 0.0
    # The covariances of so many members have an error of some per cent.
    assert np.abs(found.states - mean).max() < 0.1 * std.min() + 0.05 * SPREAD
    np.testing.assert_allclose(found.spread, std, rtol=0.1)


def test_more_members_come_nearer_to_the_kalman_filter() -> None:
    distances = []
    for members in (30, 3000):
        given, _ = record(LINEAR, members)
        mean, _ = kalman_filter(given.values)
        distances.append(np.sqrt(np.mean((observe([given], SEED)[0].states - mean) ** 2)))
    assert distances[1] < 0.3 * distances[0]


def test_the_spread_is_the_size_of_the_error() -> None:
    scores = []
    for seed in range(12):
        given, state = record(VAN_DER_POL, members=100, seed=seed)
        [found] = observe([given], SEED)
        scores.append((found.states - state) / found.spread)
    within = np.mean(np.abs(scores) < 1.645)
    assert 0.8 < within < 0.98


def test_no_estimate_uses_a_later_reading() -> None:
    given, _ = record(VAN_DER_POL, members=50)
    [whole] = observe([given], SEED)
    given.values[40:] = np.nan
    [early] = observe([given], SEED)
    np.testing.assert_array_equal(whole.states[:40], early.states[:40])
    assert not np.allclose(whole.states[40:], early.states[40:])


def test_readings_that_the_simulator_does_not_explain_have_an_error_of_the_simulator() -> None:
    right, _ = record(LINEAR, members=100)
    wrong, _ = record(LINEAR, members=100, shift=2.0)
    assert observe([right], SEED)[0].model_error == 0.0
    assert observe([wrong], SEED)[0].model_error in MODEL_ERRORS[1:]


def test_recordings_share_their_simulations() -> None:
    whole = [record(LINEAR, members=1000, seed=seed)[0] for seed in range(3)]
    records = [replace(each, values=each.values[: 40 + i]) for i, each in enumerate(whole)]
    found = observe(records, SEED)
    for given, each in zip(records, found, strict=True):
        mean, _ = kalman_filter(given.values)
        assert each.states.shape == mean.shape
        assert np.abs(each.states - mean).max() < 0.1 * SPREAD


def test_a_simulation_that_is_lost_does_not_spoil_the_gain() -> None:
    given, state = record(VAN_DER_POL, members=100)

    def states(sample: int) -> Array:
        simulated = given.states(sample).copy()
        simulated[3] = 1e6 if sample >= 10 else simulated[3]
        return simulated

    [found] = observe([replace(given, states=states)], SEED)
    late = np.abs(found.states - state)[30:] / found.spread[30:]
    assert np.isfinite(found.states).all() and late.mean() < 2


def test_time_that_is_over_is_told() -> None:
    given, _ = record(LINEAR, members=20)
    with pytest.raises(OutOfTimeError):
        observe([given], SEED, Deadline(0.0))
