"""Errors of observers with perturbations, on some of the simulations of a record.

They are compared with the errors of the observer with the mean gain, on the same simulations. The
smaller ones tell whether a gain that follows the state is worth its cost.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from dashred.inference.observer.covariances import Covariances
from dashred.inference.observer.estimate import PERTURBATIONS, Estimate
from dashred.inference.observer.observed_path import Analysis
from dashred.inference.observer.perturbation_march import PerturbationMarch
from dashred.inference.observer.simulated_errors import LOST, SimulatedErrors

Array = NDArray[np.float64]


class PerturbedErrors:
    """Observers with perturbations of some simulations of one record, and of its recording.

    Attributes:
        march: the flow of estimates with their perturbations.
        variances: expected of the errors of each trial, ``(trial, field*point)``.
        of_quantities: errors of the last forecasts of sensors and further quantities, and their
            expected variances, ``(trial, quantity)`` each.
    """

    def __init__(
        self,
        mean: SimulatedErrors,
        trials: int,
        step: float | None,
        rng: np.random.Generator,
    ) -> None:
        """Begin at the mean of the simulations, with differences of pairs of them.

        Args:
            mean: observers with the mean gain, on all simulations of the record.
            trials: number of simulations that are observed.
            step: time step of the perturbations; None for that of the simulator.
            rng: random number generator.
        """
        self._mean, self._record, self._rng = mean, mean.record, rng
        self._trials = min(trials, len(mean.simulated))
        self.march = PerturbationMarch(self._record.march, step)
        self._estimates = [self._begun() for _ in range(1 + self._trials)]
        self.variances = np.empty(0)
        self.of_quantities = np.empty(0), np.empty(0)

    @property
    def errors(self) -> Array:
        """True state minus estimate of each trial, ``(trial, field*point)``."""
        states = np.concatenate([each.state for each in self._estimates[1:]])
        found: Array = self._mean.simulated[: self._trials] - states
        return found

    @property
    def mean_errors(self) -> Array:
        """The same errors with the mean gain."""
        return self._mean.errors[: self._trials]

    def forecast(self, sample: int) -> None:
        """Run all estimates to a sample from the one before."""
        record = self._record
        begin, span = float(record.times[sample - 1]), record.span(sample)
        parts = self.march(self._estimates, begin, span)
        simulated = self._mean.simulated
        centre, reach = simulated.mean(axis=0), LOST * float(np.ptp(simulated, axis=0).max())
        for index, (each, own) in enumerate(zip(self._estimates, parts, strict=True)):
            each.arrive(own, self._mean.differences(PERTURBATIONS, self._rng))
            if not each.is_near(centre, reach):
                self._estimates[index] = self._begun()

    def analyse(self, mean: Covariances, sample: int) -> Analysis:
        """Read the sensors, and return the estimate of the recording.

        Args:
            mean: covariances of the errors with the mean gain.
            sample: index of the sample.
        """
        record, known = self._record, self._record.known(sample)
        sensors, noise = len(record.noise), record.noise
        read = record.readings(np.concatenate([each.states for each in self._estimates]), sample)
        read = read.reshape(1 + self._trials, 1 + PERTURBATIONS, -1)
        errors = record.readings(self._mean.simulated[: self._trials], sample) - read[1:, 0]
        trial_noise = noise * self._rng.standard_normal((self._trials, sensors))
        has_reading = sample < len(record.values)
        first = record.values[sample] - read[0, 0, :sensors] if has_reading else np.zeros(sensors)
        innovations = np.concatenate([first[None], errors[:, :sensors] + trial_noise])[:, known]
        variances, expected, of_quantities = [], [], []
        for each, own, innovation in zip(self._estimates, read, innovations, strict=True):
            found = each.covariances(mean, own, record.tapers)
            update = found.update(noise, known)
            each.correct(innovation, own[:, :sensors][:, known], update)
            variances.append(update.variances(found.of_state))
            expected.append(np.diag(update.of_innovations))
            of_quantities.append(found.of_quantities)
        self.variances = np.stack(variances[1:])
        self.of_quantities = errors, np.stack(of_quantities[1:])
        return Analysis(self._estimates[0].state[0], variances[0], innovations[0], expected[0])

    def _begun(self) -> Estimate:
        mean = self._mean
        state = mean.simulated.mean(axis=0, keepdims=True)
        return Estimate(state, mean.differences(PERTURBATIONS, self._rng) / np.sqrt(2))
