"""Estimate the state of a recording in real time, with gains from simulated errors.

See docs/method.md#observer. At a sample, with the errors e of the forecasts over the population of
simulations, H the sensors and R the variance of their noise::

    K = ⟨e (He)ᵀ⟩ (⟨He (He)ᵀ⟩ + R)⁻¹        û = ũ + K (y − H ũ)

The same gain corrects the estimates of the simulations, whose errors are those of the next sample.
No estimate uses a later reading. The simulator runs one state for the recording; an ensemble filter
needs tens of them. The gain is optimal in the mean over the population, and not for each state.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from dashred.core.budget import NEVER, Deadline
from dashred.inference.observer.localisation import used_sensors
from dashred.inference.observer.simulated_errors import ObservedRecord, SimulatedErrors

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
    """

    states: Array
    spread: Array
    model_error: float


class _Run(NamedTuple):
    """Estimates and their spread by record, and the innovations in expected std."""

    states: list[Array]
    spreads: list[Array]
    mean_square: float
    cost: float


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
    best: tuple[_Run, float] | None = None
    for model_error in MODEL_ERRORS:
        if best is not None and deadline.is_over:
            break
        run = _run(records, model_error, np.random.default_rng(seed), deadline)
        if best is None or run.cost < best[0].cost:
            best = run, model_error
        if run.mean_square <= EXPECTED:
            best = run, model_error
            break
    assert best is not None
    run, model_error = best
    return [
        Observation(states, spread, model_error)
        for states, spread in zip(run.states, run.spreads, strict=True)
    ]


def _run(
    records: Sequence[ObservedRecord],
    model_error: float,
    rng: np.random.Generator,
    deadline: Deadline,
) -> _Run:
    parts = [SimulatedErrors(record, model_error, rng) for record in records]
    states: list[list[Array]] = [[] for _ in records]
    spreads: list[list[Array]] = [[] for _ in records]
    squares: list[Array] = []
    members, sensors = sum(len(part.errors) for part in parts), len(records[0].noise)
    optimism = _optimism(members, used_sensors(sensors, members))
    cost, count = 0.0, max(len(record.values) for record in records)
    beginning = int(BEGINNING * count)
    for sample in range(count):
        deadline.check()
        if sample:
            for part in parts:
                part.forecast(sample)
        errors = np.concatenate([part.errors for part in parts])
        of_sensors = np.concatenate([part.of_sensors for part in parts])
        between, across = covariances(errors, of_sensors, records[0].tapers)
        for part, found, spread in zip(parts, states, spreads, strict=True):
            known = part.record.known(sample)
            expected = between[np.ix_(known, known)] + np.diag(np.square(part.record.noise[known]))
            gain: Array = np.linalg.solve(expected, across[known])
            innovations = part.analyse(gain, sample)
            if sample >= len(part.record.values):
                continue
            found.append(part.estimate)
            spread.append(optimism * np.sqrt(np.square(part.errors).mean(axis=0)))
            if sample >= beginning:
                variance = optimism**2 * np.diag(expected)
                squares.append(np.square(innovations) / variance)
                cost += float((np.log(variance) + squares[-1]).sum())
    joined = np.concatenate(squares) if squares else np.empty(0)
    mean_square = float(joined.mean()) if len(joined) else 0.0
    return _Run(
        [np.stack(each) for each in states],
        [np.stack(each) for each in spreads],
        mean_square,
        cost if math.isfinite(cost) else math.inf,
    )


def covariances(errors: Array, of_quantities: Array, tapers: Array) -> tuple[Array, Array]:
    """Return the covariances of sensors with quantities, and with the state.

    Args:
        errors: of the state, ``(member, field*point)``.
        of_quantities: of sensors and further quantities, ``(member, quantity)``.
        tapers: localisation, ``(sensor, quantity and field*point)``.

    Returns:
        ``(sensor, quantity)`` and ``(sensor, field*point)``.
    """
    sensors, quantities = len(tapers), of_quantities.shape[1]
    known = of_quantities[:, :sensors].T / len(errors)
    return tapers[:, :quantities] * (known @ of_quantities), tapers[:, quantities:] * (
        known @ errors
    )


def _optimism(members: int, sensors: int) -> float:
    """Return the std of an error over that of the members from which the gain comes.

    A regression on so many readings explains a part of the errors of its own members by chance
    (Akaike, Ann. Inst. Stat. Math. 21, 1969: final prediction error).
    """
    return math.sqrt((members + sensors) / max(1, members - sensors))
