"""The gains of an observer of a stream, learnt on simulations that start in the climate."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dashred.inference.observer.both_gains import BothGains
from dashred.inference.observer.covariances import Covariances
from dashred.inference.observer.march import March
from dashred.inference.observer.observed_record import ObservedRecord
from dashred.inference.streaming.live_estimator import MIXING
from dashred.inference.streaming.readout import Readout

Array = NDArray[np.float64]

# Number of simulations, and of samples of each. The gain of the last half is steady.
SIMULATIONS, SAMPLES = 128, 120


@dataclass(frozen=True)
class LiveGains:
    """Covariances of the errors of the forecasts, by the number of samples since the beginning.

    Attributes:
        means: over simulations, by sample.
        perturbations: number beside the estimate, for a gain that follows the state; or 0.
        factor: squared error of each quantity over its expected variance, ``(quantity,)``.
    """

    means: Sequence[Covariances]
    perturbations: int
    factor: Array

    def at(self, sample: int) -> Covariances:
        """Return the mean covariances of a sample; they no longer change after the last one."""
        return self.means[min(sample, len(self.means) - 1)]


def learn_gains(
    march: March,
    readout: Readout,
    tapers: Array,
    noise: Array,
    climate: Array,
    span: float,
    model_error: float,
    step: float | None,
    seed: int,
) -> LiveGains:
    """Observe simulations, and average the covariances of their later samples.

    On some of them, a gain that follows the state is tried (:class:`.both_gains.BothGains`).

    Args:
        march: the simulator.
        readout: sensors first, then further quantities.
        tapers: localisation, ``(sensor, quantity and field*point)``.
        noise: σ of the sensors.
        climate: states that the system may be in, ``(state, field*point)``.
        span: time between samples.
        model_error: see :class:`.simulated_errors.SimulatedErrors`.
        step: time step of perturbations; None for that of the simulator.
        seed: of the random numbers.
    """
    simulations = _Simulations(march, climate, span, np.random.default_rng(seed))
    record = ObservedRecord(
        march=march,
        states=simulations,
        times=march.begin + span * np.arange(SAMPLES, dtype=np.float64),
        values=np.zeros((0, len(noise))),
        noise=noise,
        operator=readout.operator,
        tapers=tapers,
    )
    observers = BothGains([record], model_error, step, [seed])
    means, found, expected = [], [], []
    for _ in range(SAMPLES):
        means.append(observers.forecast())
        observers.analyse(means[-1])
        errors, variances = observers.perturbed[0].of_quantities
        found.append(np.square(errors).mean(axis=0))
        expected.append(variances.mean(axis=0))
    half = SAMPLES // 2
    steady = Covariances(*(np.mean(each, axis=0) for each in zip(*means[half:], strict=True)))
    perturbations = observers.perturbations
    factor = np.ones(len(expected[0]))
    if perturbations:
        known = np.maximum(np.sum(expected[half:], axis=0), np.finfo(np.float64).tiny)
        factor = np.sum(found[half:], axis=0) / known
    return LiveGains([*means[:half], steady], perturbations, factor)


class _Simulations:
    """Runs of the simulator, of which only the present states are kept."""

    def __init__(self, march: March, climate: Array, span: float, rng: np.random.Generator) -> None:
        chosen = rng.integers(len(climate), size=(3, SIMULATIONS))
        self._states = climate[chosen[0]] + MIXING * (climate[chosen[1]] - climate[chosen[2]])
        self._march, self._climate, self._span, self._rng = march, climate, span, rng
        self._farthest = np.abs(climate).max() + np.ptp(climate)
        self._sample = 0

    def __call__(self, sample: int) -> Array:
        """Return the states at a sample, ``(simulation, field*point)``; samples are in order."""
        while self._sample < sample:
            begin = self._march.begin + self._span * self._sample
            self._states = self._march(self._states, begin, self._span)
            self._sample += 1
            size = np.abs(self._states).max(axis=1)
            lost = ~(np.where(np.isfinite(size), size, math.inf) <= self._farthest)
            again = self._rng.integers(len(self._climate), size=int(lost.sum()))
            self._states[lost] = self._climate[again]
        return self._states.copy()
