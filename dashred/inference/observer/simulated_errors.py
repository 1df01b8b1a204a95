"""Errors of an observer on simulations, where the true state is known.

The observer also runs on every simulation of a population. The covariances of its errors over the
population, at each sample, give the gain with which it reads the recording. For a linear system and
a large population this is the Kalman filter.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from statistics import median

import numpy as np
from numpy.typing import NDArray
from torch import Tensor

from dashred.data.observation_operator import ObservationOperator
from dashred.inference.observer.march import March
from dashred.inference.observer.random_differences import random_differences

Array = NDArray[np.float64]

# An error this many times as large as the median of all is that of an observer that is lost.
LOST = 10.0
# Number of timed steps.
TIMED_STEPS = 20


@dataclass(frozen=True)
class ObservedRecord:
    """A recording that is observed, and simulations of the system that it comes from.

    Attributes:
        march: the simulator from sample to sample.
        states: returns the states of the simulations at a sample, ``(member, field*point)``; the
            samples are asked for in order.
        times: ``(time,)``, of the simulations; the recording may end earlier.
        values: readings, ``(sample, sensor)``; NaN where missing.
        noise: σ of each sensor, ``(sensor,)``.
        operator: observation operator of the sensors, and of further quantities after them.
        tapers: localisation, ``(sensor, quantity and field*point)``.
    """

    march: March
    states: Callable[[int], Array]
    times: Array
    values: Array
    noise: Array
    operator: ObservationOperator
    tapers: Array

    def span(self, sample: int) -> float:
        """Return the time from the sample before, equal for all samples of a clock."""
        return float(f"{self.times[sample] - self.times[sample - 1]:.12g}")

    def readings(self, states: Array, sample: int) -> Array:
        """Return what the sensors read of states, ``(state, quantity)``, without noise."""
        on_grid: Tensor = self.march.on_grid(states)
        return self.operator(on_grid, float(self.times[sample])).numpy()

    def seconds_per_step(self, states: Array) -> float:
        """Return the median time of a step: the simulator, the readings and the gain.

        Args:
            states: of the first sample, and with each perturbation,
                ``(1 + perturbation, field*point)``.
        """
        gain = np.zeros((len(self.noise), states.shape[1]))
        taken = []
        for _ in range(TIMED_STEPS):
            began = time.perf_counter()
            later = self.march(states, float(self.times[0]), self.span(1))
            later + (self.values[0] - self.readings(later, 1)) @ gain
            taken.append(time.perf_counter() - began)
        return median(taken)

    def known(self, sample: int) -> NDArray[np.bool_]:
        """Return which sensors have a reading at a sample, ``(sensor,)``."""
        if sample >= len(self.values):
            return np.ones(len(self.noise), dtype=np.bool_)
        return ~np.isnan(self.values[sample])


class SimulatedErrors:
    """The observer on the simulations of one record, and on its recording.

    Attributes:
        simulated: states of the simulations, ``(member, field*point)``.
        errors: true state minus estimate, ``(member, field*point)``.
        of_sensors: the same for what the sensors read, ``(member, quantity)``.
        estimate: of the state in the recording, ``(field*point,)``.
    """

    def __init__(
        self, record: ObservedRecord, model_error: float, rng: np.random.Generator
    ) -> None:
        """Begin at the mean of the simulations, before the first reading.

        Args:
            record: the recording and its simulations.
            model_error: std of the error of the simulator in each interval between samples, as a
                share of the differences of two simulations.
            rng: random number generator.
        """
        self.record, self._model_error, self._rng = record, model_error, rng
        self.simulated = record.states(0)
        self.estimate = self.simulated.mean(axis=0)
        self.errors = self.simulated - self.estimate
        self.of_sensors = np.empty(0)
        self._read(0)

    def forecast(self, sample: int) -> None:
        """Run the estimates to a sample from the one before."""
        record, members = self.record, len(self.errors)
        states = np.concatenate([self.simulated - self.errors, self.estimate[None]])
        states = record.march(states, float(record.times[sample - 1]), record.span(sample))
        self.simulated = record.states(sample)
        self.errors = self.simulated - states[:members]
        self._replace_lost()
        if self._model_error:
            self.errors += (
                self._model_error / np.sqrt(2) * self.differences(len(self.errors), self._rng)
            )
        # The estimate may blow up, and then begins again.
        own = states[members]
        self.estimate = own if np.isfinite(own).all() else self.simulated.mean(axis=0)
        self._read(sample)

    def analyse(self, gain: Array, sample: int) -> Array:
        """Read the sensors with a gain, ``(known sensor, field*point)``.

        Returns:
            the innovations of the recording, ``(known sensor,)``.
        """
        record, known = self.record, self.record.known(sample)
        count = len(record.noise)
        noise = record.noise * self._rng.standard_normal((len(self.errors), count))
        self.errors -= (self.of_sensors[:, :count] + noise)[:, known] @ gain
        expected = record.readings(self.estimate[None], sample)[0]
        if sample >= len(record.values):
            return np.empty(0)
        innovations: Array = (record.values[sample] - expected)[known]
        self.estimate = self.estimate + innovations @ gain
        return innovations

    def _read(self, sample: int) -> None:
        read = self.record.readings
        estimates = self.simulated - self.errors
        self.of_sensors = read(self.simulated, sample) - read(estimates, sample)

    def differences(self, count: int, rng: np.random.Generator) -> Array:
        """Return differences of random pairs of simulations, ``(count, field*point)``."""
        return random_differences(self.simulated, count, rng)

    def _replace_lost(self) -> None:
        """Give members that are lost the errors of others: they would dominate the covariances."""
        sizes = np.sqrt(np.square(self.errors).mean(axis=1))
        sizes = np.where(np.isfinite(sizes), sizes, np.inf)
        lost = (sizes > LOST * np.median(sizes)) | np.isinf(sizes)
        if lost.any() and not lost.all():
            others = self._rng.choice(np.flatnonzero(~lost), int(lost.sum()))
            self.errors[lost] = self.errors[others]
