"""Observers with the mean gain and with a gain that follows the state, on the same records.

Both also observe simulations, whose states are known. The gain follows the state where that makes
the errors on these clearly smaller. The readings of the recording have no part in this choice.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from dashred.inference.observer.covariances import Covariances
from dashred.inference.observer.errors_by_field import SpreadFactor, mean_log_square
from dashred.inference.observer.estimate import PERTURBATIONS
from dashred.inference.observer.localisation import used_sensors
from dashred.inference.observer.observed_path import Analysis
from dashred.inference.observer.observed_record import ObservedRecord
from dashred.inference.observer.perturbed_errors import PerturbedErrors
from dashred.inference.observer.simulated_errors import SimulatedErrors

Array = NDArray[np.float64]

# Simulations of all records on which the two are compared. The gain follows the state if the
# logarithms of the squared errors are smaller by this margin in the mean over so many samples at
# least. A smaller difference may be chance, and the mean gain costs less.
TRIALS, MARGIN, LEAST = 8, 0.3, 20


class BothGains:
    """Both observers, sample by sample.

    Attributes:
        perturbed: observers with perturbations, by record.

    Args:
        records: recordings of one system with their simulations.
        model_error: see :class:`.SimulatedErrors`.
        step: time step of the perturbations; None for that of the simulator.
        seed: of the random numbers.
    """

    def __init__(
        self,
        records: Sequence[ObservedRecord],
        model_error: float,
        step: float | None,
        seed: Sequence[int],
    ) -> None:
        rng = np.random.default_rng(seed)
        self._parts = [SimulatedErrors(record, model_error, rng) for record in records]
        own = np.random.default_rng([*seed, PERTURBATIONS])
        trials = max(1, TRIALS // len(records))
        self.perturbed = [PerturbedErrors(part, trials, step, own) for part in self._parts]
        self._fields, self._tapers = len(records[0].march.system.fields), records[0].tapers
        self._factor = SpreadFactor(self._fields)
        self._gain, self._samples = 0.0, 0
        members, sensors = sum(len(part.errors) for part in self._parts), len(records[0].noise)
        self._optimism = _optimism(members, used_sensors(sensors, members))

    @property
    def perturbations(self) -> int:
        """Number of perturbations beside an estimate; 0 where the mean gain is used."""
        return PERTURBATIONS if self._gain > MARGIN * max(self._samples, LEAST) else 0

    def forecast(self) -> Covariances:
        """Go to the next sample; return the covariances of the errors with the mean gain."""
        if self._samples:
            for part, other in zip(self._parts, self.perturbed, strict=True):
                part.forecast(self._samples)
                other.forecast(self._samples)
        self._samples += 1
        return Covariances.of_errors(
            np.concatenate([part.errors for part in self._parts]),
            np.concatenate([part.of_sensors for part in self._parts]),
            self._tapers,
        )

    def analyse(self, mean: Covariances) -> list[Analysis]:
        """Read the sensors, and return the estimate of each recording.

        Args:
            mean: covariances of the forecast.
        """
        by_mean = [self._analyse(part, mean) for part in self._parts]
        by_state = [other.analyse(mean, self._samples - 1) for other in self.perturbed]
        errors = np.concatenate([other.errors for other in self.perturbed])
        self._factor.add(errors, np.concatenate([other.variances for other in self.perturbed]))
        fixed = np.concatenate([other.mean_errors for other in self.perturbed])
        self._gain += mean_log_square(fixed, self._fields) - mean_log_square(errors, self._fields)
        if not self.perturbations:
            return by_mean
        return [each._replace(variances=self._factor.scaled(each.variances)) for each in by_state]

    def _analyse(self, part: SimulatedErrors, mean: Covariances) -> Analysis:
        sample, optimism = self._samples - 1, self._optimism
        noise, known = part.record.noise, part.record.known(sample)
        update = mean.update(noise, known)
        innovations = part.analyse(update, sample)
        expected = optimism**2 * np.diag(update.of_innovations)
        variances = optimism**2 * np.square(part.errors).mean(axis=0)
        return Analysis(part.estimate, variances, innovations, expected)


def _optimism(members: int, sensors: int) -> float:
    """Return the std of an error over that of the members from which the gain comes.

    A regression on so many readings explains a part of the errors of its own members by chance
    (Akaike, Ann. Inst. Stat. Math. 21, 1969: final prediction error).
    """
    return math.sqrt((members + sensors) / max(1, members - sensors))
