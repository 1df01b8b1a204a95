"""Integrate a mechanism whose law changes at events: SciPy's Radau, phase by phase."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np

from dashred.evaluation.foreign.cases.case import Array

Force = Callable[[float, Array], Array]
"""Tendency of every state at a time."""

TOLERANCE = 1e-9
# Largest step as a share of the record: an event must not be stepped over.
LARGEST_STEP = 1e-2


@dataclass(frozen=True)
class Exit:
    """The end of a phase.

    Attributes:
        value: passes through 0 at the event, ``value(t, state)``.
        direction: of the passage: 1 upwards, -1 downwards.
        to: name of the next phase, given the time and state of the event.
    """

    value: Callable[[float, Array], float]
    direction: int
    to: Callable[[float, Array], str]


@dataclass(frozen=True)
class Phase:
    """A phase with a smooth law.

    Attributes:
        lacking: the tendency that the simulator lacks.
        exits: how it ends.
    """

    lacking: Force
    exits: tuple[Exit, ...] = ()


def integrate_phases(
    known: Force, phases: Mapping[str, Phase], begin: str, start: Array, times: Array
) -> tuple[Array, Array]:
    """Return the states and what the simulator lacks, both ``(time, state)``.

    Args:
        known: tendency of the simulator.
        phases: by name.
        begin: name of the first phase.
        start: initial state.
        times: of the samples, increasing.

    Raises:
        ArithmeticError: the solver fails.
    """
    from scipy.integrate import solve_ivp

    states, lacking = np.full((2, len(times), len(start)), np.nan)
    name, now, state = begin, float(times[0]), start
    span = float(times[-1] - times[0])
    while True:
        phase = phases[name]
        tendency: Any = partial(_tendency, known, phase.lacking)
        events: list[Any] = [_event(exit_) for exit_ in phase.exits]
        solved: Any = solve_ivp(
            tendency,
            (now, times[-1]),
            state,
            method="Radau",
            rtol=TOLERANCE,
            atol=TOLERANCE,
            max_step=LARGEST_STEP * span,
            events=events,
            dense_output=True,
        )
        if not solved.success:
            raise ArithmeticError(f"the truth cannot be integrated: {solved.message}")
        ended = float(solved.t[-1])
        # A short phase may have no sample.
        for i in np.flatnonzero((times >= now) & (times <= ended)):
            states[i] = solved.sol(times[i])
            lacking[i] = phase.lacking(times[i], states[i])
        if solved.status != 1:
            return states, lacking
        which = next(i for i, found in enumerate(solved.t_events) if len(found))
        now, state = ended, solved.y_events[which][-1]
        name = phase.exits[which].to(now, state)


def _tendency(known: Force, lacking: Force, t: float, state: Array) -> Array:
    return known(t, state) + lacking(t, state)


def _event(exit_: Exit) -> Callable[[float, Array], float]:
    def event(t: float, state: Array) -> float:
        return float(exit_.value(t, state))

    event.terminal = True  # type: ignore[attr-defined]
    event.direction = exit_.direction  # type: ignore[attr-defined]
    return event
