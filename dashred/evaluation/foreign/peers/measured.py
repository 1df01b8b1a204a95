"""What a method that reads the sensors is given: the recording, the simulator, and the noise."""

from __future__ import annotations

import csv
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from dashred.config import load_config
from dashred.evaluation.baselines.estimate import TermEntry
from dashred.evaluation.foreign.cases.case import Array
from dashred.evaluation.foreign.cases.case_files import CONFIG, RECORDING, read_simulator
from dashred.evaluation.foreign.peers.full_state import FullState, read_full_state
from dashred.physics.system import System, Term
from dashred.physics.terms.library import build_library

# Largest mean square of the misfits of a fit, in units of the noise: one is expected.
WORST_FIT = 2.0


class NoAnswerError(Exception):
    """The method has no answer: it cannot be asked about the case, is lost, or nothing fits."""


def check_fit(misfit: float) -> None:
    """Check that a trajectory fits.

    Args:
        misfit: mean square of its misfits to the readings, in units of the noise.

    Raises:
        NoAnswerError: it does not.
    """
    if not misfit <= WORST_FIT:
        raise NoAnswerError(f"the best fit leaves {misfit:.3g} times the variance of the noise")


def entries_of(terms: Sequence[Term], coefficients: Array) -> list[TermEntry]:
    """Return terms with their coefficients, ``(term,)``, as a law."""
    return [
        TermEntry(equation=term.equation, term=str(term), coefficient=float(value))
        for term, value in zip(terms, coefficients, strict=True)
    ]


@dataclass(frozen=True)
class Measured:
    """Readings of some fields of a system of ordinary differential equations.

    Attributes:
        system: the simulator.
        library: candidate terms of the analysis.
        times: ``(time,)``.
        readings: ``(time, sensor)``.
        columns: index of the field that each sensor reads, ``(sensor,)``.
        noise: std of the noise of each sensor, ``(sensor,)``.
        start: mean of the prior of the initial state, ``(field,)``.
        spread: its std, ``(field,)``.
        seed: of the method.
    """

    system: System
    library: list[Term]
    times: Array
    readings: Array
    columns: list[int]
    noise: Array
    start: Array
    spread: Array
    seed: int

    @property
    def scale(self) -> Array:
        """Typical size of the deviations of each field, ``(field,)``.

        The std of the readings; of a field that is not measured, ten times its spread, as the
        spread of a case is a tenth of the std.
        """
        scale = 10 * self.spread
        scale[self.columns] = self.readings.std(axis=0)
        return scale

    @property
    def first_states(self) -> Array:
        """First guess of the states: the readings, and the start where there are none."""
        states = np.tile(self.start, (len(self.times), 1))
        states[:, self.columns] = self.readings
        return states


def read_measured(folder: Path) -> Measured:
    """Read the recording of a case; the std of the noise is told.

    Raises:
        NoAnswerError: a sensor does not read a field, or the start has no numbers.
    """
    config, system = load_config([f"conf={folder / CONFIG}"], entry="train"), read_simulator(folder)
    with (folder / RECORDING).open(encoding="utf-8", newline="") as file:
        header, *rows = csv.reader(file)
    if unknown := set(header[1:]) - set(system.fields):
        raise NoAnswerError(f"the sensor {min(unknown)} does not read a field")
    values = np.array(rows, dtype=np.float64)
    share = read_full_state(folder)
    return _of(
        system,
        build_library(system, config.library),
        values[:, 0],
        values[:, 1:],
        [system.fields.index(name) for name in header[1:]],
        share,
    )


def all_measured(full: FullState) -> Measured:
    """Return the full noisy state as readings of all fields."""
    columns = list(range(len(full.system.fields)))
    return _of(full.system, full.library, full.times, full.noisy, columns, full)


def _of(
    system: System,
    library: list[Term],
    times: Array,
    readings: Array,
    columns: list[int],
    full: FullState,
) -> Measured:
    stated = system.config
    try:
        start = np.array([float(stated.start[name]) for name in system.fields])
        spread = np.array([float(str(stated.spread[name])) for name in system.fields])
    except (KeyError, TypeError, ValueError):
        raise NoAnswerError("the start and its spread are not a number each") from None
    noise = full.noise * full.std[columns]
    return Measured(system, library, times, readings, columns, noise, start, spread, full.seed)
