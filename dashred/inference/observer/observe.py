"""Estimate the state of a recording in real time, with gains from simulated errors.

See docs/method.md#observer. At a sample, with the errors e of the forecasts over the population of
simulations, H the sensors and R the variance of their noise::

    K = ⟨e (He)ᵀ⟩ (⟨He (He)ᵀ⟩ + R)⁻¹        û = ũ + K (y − H ũ)

The same gain corrects the estimates of the simulations, whose errors are those of the next sample.
No estimate uses a later reading. This gain is optimal in the mean over the population. Where
perturbations about each estimate make the errors of simulations smaller (:mod:`.estimate`), the
gain follows the state.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dashred.core.budget import NEVER, Deadline
from dashred.inference.observer.both_gains import BothGains
from dashred.inference.observer.observed_path import ObservedPath
from dashred.inference.observer.observed_record import ObservedRecord
from dashred.inference.observer.perturbation_march import PerturbationMarch, perturbation_step

Array = NDArray[np.float64]

# Errors of the simulator in an interval between samples that are tried in turn, as shares of the
# differences of two simulations.
MODEL_ERRORS = (0.0, 1e-3, 1e-2, 1e-1)
# Innovations whose mean square is at most so many times the expected one are as expected.
EXPECTED = 1.3
# The innovations of the first samples say how well the start was known.
BEGINNING = 0.2


@dataclass(frozen=True)
class Observation:
    """The estimates of one recording.

    Attributes:
        states: estimate at each sample, ``(time, field*point)``.
        spread: its standard deviation, ``(time, field*point)``.
        model_error: as in :class:`.SimulatedErrors`.
        perturbations: number beside the estimate at the end; 0 with the mean gain.
        march: the flow of the estimate with them.
    """

    states: Array
    spread: Array
    model_error: float
    perturbations: int
    march: PerturbationMarch


def observe(
    records: Sequence[ObservedRecord], seed: Sequence[int], deadline: Deadline = NEVER
) -> list[Observation]:
    """Observe recordings of one system, with the smallest error of the simulator that fits.

    It fits if the innovations are as large as the population makes them expect. If no one does, the
    one under which the innovations are the most likely is taken.

    Args:
        records: with simulations of each; the errors of all of them give one gain.
        seed: of the random numbers.
        deadline: time at which it ends.

    Raises:
        OutOfTimeError: the deadline is over before the first run has ended.
    """
    first = records[0]
    step = perturbation_step(first.march, first.states(0), float(first.times[0]), first.span(1))
    best: tuple[ObservedPath, BothGains, float] | None = None
    for model_error in MODEL_ERRORS:
        if best is not None and deadline.is_over:
            break
        observers = BothGains(records, model_error, step, seed)
        path = _run(observers, records, deadline)
        if best is None or path.cost < best[0].cost or path.mean_square <= EXPECTED:
            best = path, observers, model_error
        if path.mean_square <= EXPECTED:
            break
    assert best is not None
    path, observers, model_error = best
    count = observers.perturbations
    return [
        Observation(np.stack(states), np.stack(spread), model_error, count, each.march)
        for states, spread, each in zip(path.states, path.spreads, observers.perturbed, strict=True)
    ]


def _run(
    observers: BothGains, records: Sequence[ObservedRecord], deadline: Deadline
) -> ObservedPath:
    count = max(len(record.values) for record in records)
    path = ObservedPath(len(records), int(BEGINNING * count))
    for sample in range(count):
        deadline.check()
        analyses = observers.analyse(observers.forecast())
        for index, (record, found) in enumerate(zip(records, analyses, strict=True)):
            if sample < len(record.values):
                path.add(index, found)
    return path
