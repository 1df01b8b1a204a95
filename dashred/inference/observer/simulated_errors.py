"""Errors of an observer on simulations, where the true state is known.

The observer also runs on every simulation of a population. The covariances of its errors over the
population, at each sample, give the gain with which it reads the recording. For a linear system and
a large population this is the Kalman filter.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from dashred.inference.observer.covariances import Update
from dashred.inference.observer.observed_record import ObservedRecord
from dashred.inference.observer.random_differences import random_differences

Array = NDArray[np.float64]

# An error this many times as large as the median of all, or a state farther than this multiple of
# the range of the simulations from their mean, is that of an observer that is lost.
LOST = 10.0


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

    def analyse(self, update: Update, sample: int) -> Array:
        """Read the sensors.

        Args:
            update: by the known sensors.
            sample: index of the sample.

        Returns:
            the innovations of the recording, ``(known sensor,)``.
        """
        record, known = self.record, self.record.known(sample)
        count = len(record.noise)
        noise = record.noise * self._rng.standard_normal((len(self.errors), count))
        self.errors -= update.corrections((self.of_sensors[:, :count] + noise)[:, known])
        expected = record.readings(self.estimate[None], sample)[0]
        if sample >= len(record.values):
            return np.empty(0)
        innovations: Array = (record.values[sample] - expected)[known]
        self.estimate = self.estimate + update.corrections(innovations[None])[0]
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
