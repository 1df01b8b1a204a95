"""The gains of an observer of a stream, learnt on simulations that start in the climate."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dashred.inference.observer.march import March
from dashred.inference.observer.observe import covariances
from dashred.inference.observer.simulated_errors import ObservedRecord, SimulatedErrors
from dashred.inference.streaming.live_estimator import MIXING
from dashred.inference.streaming.readout import Readout

Array = NDArray[np.float64]

# Number of simulations, and of samples of each. The gain of the last half is steady.
SIMULATIONS, SAMPLES = 128, 120


@dataclass(frozen=True)
class LiveGains:
    """Covariances of the errors of the forecasts, by the number of samples since the beginning.

    Attributes:
        between: of sensors and quantities, ``(sample, sensor, quantity)``.
        variances: of the quantities, ``(sample, quantity)``.
        across: of sensors and state, ``(sample, sensor, field*point)``.
    """

    between: Array
    variances: Array
    across: Array

    def at(self, sample: int) -> tuple[Array, Array, Array]:
        """Return all for a sample; they no longer change after the last one."""
        index = min(sample, len(self.between) - 1)
        return self.between[index], self.variances[index], self.across[index]


def learn_gains(
    march: March,
    readout: Readout,
    tapers: Array,
    noise: Array,
    climate: Array,
    span: float,
    model_error: float,
    seed: int,
) -> LiveGains:
    """Observe simulations, and average the covariances of their later samples.

    Args:
        march: the simulator.
        readout: sensors first, then further quantities.
        tapers: localisation, ``(sensor, quantity and field*point)``.
        noise: σ of the sensors.
        climate: states that the system may be in, ``(state, field*point)``.
        span: time between samples.
        model_error: see :class:`.simulated_errors.SimulatedErrors`.
        seed: of the random numbers.
    """
    rng = np.random.default_rng(seed)
    simulations = _Simulations(march, climate, span, rng)
    record = ObservedRecord(
        march=march,
        states=simulations,
        times=march.begin + span * np.arange(SAMPLES, dtype=np.float64),
        values=np.zeros((0, len(noise))),
        noise=noise,
        operator=readout.operator,
        tapers=tapers,
    )
    errors, sensors = SimulatedErrors(record, model_error, rng), len(noise)
    learnt = []
    for sample in range(SAMPLES):
        if sample:
            errors.forecast(sample)
        between, across = covariances(errors.errors, errors.of_sensors, tapers)
        learnt.append((between, np.square(errors.of_sensors).mean(axis=0), across))
        expected = between[:, :sensors] + np.diag(np.square(noise))
        gain: Array = np.linalg.solve(expected, across)
        errors.analyse(gain, sample)
    half = SAMPLES // 2
    return LiveGains(
        *(
            np.stack([*each[:half], np.mean(each[half:], axis=0)])
            for each in zip(*learnt, strict=True)
        )
    )


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
