"""A recording that is observed, with simulations of the system that it comes from."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from statistics import median

import numpy as np
from numpy.typing import NDArray
from torch import Tensor

from dashred.data.observation_operator import ObservationOperator
from dashred.inference.observer.covariances import Covariances
from dashred.inference.observer.estimate import Estimate
from dashred.inference.observer.march import March
from dashred.inference.observer.perturbation_march import PerturbationMarch

Array = NDArray[np.float64]

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

    def known(self, sample: int) -> NDArray[np.bool_]:
        """Return which sensors have a reading at a sample, ``(sensor,)``."""
        if sample >= len(self.values):
            return np.ones(len(self.noise), dtype=np.bool_)
        return ~np.isnan(self.values[sample])

    def seconds_per_step(self, states: Array, march: PerturbationMarch) -> float:
        """Return the median time of a step: the simulator, the readings and their update.

        Args:
            states: of the samples, ``(time, field*point)``. The first one is the estimate, and the
                others are taken for its perturbations.
            march: the flow of an estimate with its perturbations.
        """
        read = self.readings(states, 0)
        mean = Covariances.of_errors(
            states - states.mean(axis=0), read - read.mean(axis=0), self.tapers
        )
        every, taken = np.arange(len(self.noise)), []
        for _ in range(TIMED_STEPS):
            estimate = Estimate(states[:1], states[1:] - states[:1])
            began = time.perf_counter()
            [later] = march([estimate], float(self.times[0]), self.span(1))
            estimate.arrive(later, np.zeros(1))
            read = self.readings(estimate.states, 1)
            update = estimate.covariances(mean, read, self.tapers).update(self.noise, every)
            estimate.correct(self.noise, read[:, : len(every)], update)
            taken.append(time.perf_counter() - began)
        return median(taken)
