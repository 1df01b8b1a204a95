"""The noise of readings that change as fast as they are sampled."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.signal import StateSpace, lfilter

from dashred.data.fast_signals import is_fast, predicted_noise
from dashred.data.noise_level import noise_std
from dashred.data.recording import Recording
from dashred.data.sensors import Sensor
from dashred.physics.backends.input_signals import NO_INPUTS, InputSignals

Array = NDArray[np.float64]
RNG = np.random.default_rng(7)
TIMES: Array = 0.1 * np.arange(3000, dtype=np.float64)
DRIVE: Array = np.convolve(RNG.standard_normal(3004), np.ones(5) / 5, "valid").astype(np.float64)


def resonator(std: float, period: float = 9.0) -> Recording:
    """Return x of ``x'' = -ω² x - 0.1 ω x' + ω² u`` with u a random drive, of rms 1 and noise."""
    omega = 2 * np.pi / (0.1 * period)
    a, b = np.array([[0, 1], [-(omega**2), -0.1 * omega]]), np.array([[0.0], [omega**2]])
    found = StateSpace(a, b, np.array([[1.0, 0.0]]), np.zeros((1, 1))).to_discrete(0.1, "foh")  # type: ignore[attr-defined]
    a, b, c = found.A, found.B, found.C
    poles = np.poly(np.linalg.eigvals(a))
    impulse = [float((c @ np.linalg.matrix_power(a, k) @ b).item()) for k in range(3)]
    zeros = [0.0, *np.convolve(poles, impulse)[:2]]
    x = lfilter(zeros, poles, DRIVE)
    x = np.asarray(x / x.std() + std * RNG.standard_normal(len(x)), dtype=np.float64)
    return Recording((Sensor("x", "x"),), TIMES, x[:, None], InputSignals(TIMES, {"u": DRIVE}))


@pytest.mark.parametrize("std", [1e-3, 3e-3, 1e-2])
def test_the_noise_of_a_driven_resonator_is_found(std: float) -> None:
    """At nine samples per period, third differences show 7 % of the signal."""
    recording = resonator(std)
    undriven = replace(recording, inputs=NO_INPUTS)
    assert float(noise_std(recording)[0]) == pytest.approx(std, rel=0.2)
    assert float(noise_std(undriven)[0]) > 0.06


def test_missing_values_and_spikes_are_passed_over() -> None:
    values = resonator(1e-2).values[:, 0].copy()
    values[::11] = np.nan
    values[5::97] += 3
    found = predicted_noise(TIMES, values, InputSignals(TIMES, {"u": DRIVE}))
    assert found == pytest.approx(1e-2, rel=0.3)


def test_it_is_an_upper_bound() -> None:
    noise: Array = RNG.standard_normal(3000)
    assert predicted_noise(TIMES, noise, NO_INPUTS) == pytest.approx(1, rel=0.1)
    unpredicted = predicted_noise(TIMES, noise + 2 * np.sign(np.sin(37 * TIMES**1.5)), NO_INPUTS)
    assert unpredicted > 1
    assert predicted_noise(TIMES[:50], noise[:50], NO_INPUTS) == np.inf


@pytest.mark.parametrize(
    ("values", "fast"),
    {
        "white noise": (RNG.standard_normal(3000), False),
        "a random walk": (np.cumsum(RNG.standard_normal(3000)), False),
        "a slow wave with noise": (np.sin(TIMES / 5) + 0.01 * RNG.standard_normal(3000), False),
        "a fast wave": (np.sin(7 * TIMES), True),
        "a constant": (np.ones(3000), False),
    }.values(),
)
def test_fast_signals_are_told_from_noise(values: Array, fast: bool) -> None:
    assert is_fast(TIMES, values) == fast
    assert not is_fast(np.sort(RNG.uniform(0, 300, 3000)), values)
