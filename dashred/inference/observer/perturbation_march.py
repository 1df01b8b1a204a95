"""Run an estimate with accurate steps, and its perturbations with longer ones.

A perturbation is the difference of two runs. With equal steps, the errors of these largely cancel.
It need not be exact either, because it gives covariances alone.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import torch
from numpy.typing import NDArray

from dashred.inference.observer.estimate import Estimate
from dashred.inference.observer.march import March
from dashred.physics.runs.step_stability import Along, is_stable

Array = NDArray[np.float64]

# Numbers of steps between two samples that are tried, in turn.
STEPS = (1, 2, 3, 4, 6, 8)
# Steps are not too long if, after so many samples, the differences of so many pairs of simulations
# have at most this error in each field.
PAIRS, SAMPLES, TOLERANCE = 8, 8, 0.05
# Number of samples over which the steps must not amplify rounding errors.
DURATION = 1000


class PerturbationMarch:
    """The flow of estimates with their perturbations.

    Args:
        march: flow of the estimate.
        step: time step of the perturbations; None for that of the estimate.
    """

    def __init__(self, march: March, step: float | None) -> None:
        self._march = march
        self._coarse = None if step is None else march.with_step(step)

    def __call__(
        self,
        estimates: Sequence[Estimate],
        begin: float,
        span: float,
        known: float | None = None,
    ) -> list[Array]:
        """Return the forecast of :attr:`.Estimate.states` of each estimate.

        Args:
            estimates: at a time.
            begin: the time.
            span: length of the forecast.
            known: see :meth:`.march.March.__call__`.
        """
        states = np.concatenate([each.states for each in estimates])
        ends = np.cumsum([len(each.states) for each in estimates])
        coarse = self._coarse if len(states) > len(estimates) else None
        rough = None if coarse is None else coarse(states, begin, span, known)
        # Long steps may blow up where those of the estimate do not.
        if rough is None or not np.isfinite(rough).all():
            return np.split(self._march(states, begin, span, known), ends[:-1])
        exact = self._march(np.concatenate([e.state for e in estimates]), begin, span, known)
        parts = np.split(rough, ends[:-1])
        return [state + (own - own[:1]) for state, own in zip(exact, parts, strict=True)]


def perturbation_step(march: March, states: Array, begin: float, span: float) -> float | None:
    """Return the longest time step that perturbations may take; None for that of the simulator.

    Args:
        march: the simulator from sample to sample.
        states: that the system may be in, ``(state, field*point)``.
        begin: time at which they are.
        span: time between two samples.
    """
    if not march.takes_other_steps or len(states) < 2:
        return None
    pairs = states[: 2 * min(PAIRS, len(states) // 2)]
    fields, exact = len(march.system.fields), _differences(march, pairs, begin, span)
    size = mean_squares(exact, fields)
    for count in STEPS:
        coarse = march.with_step(span / count)
        if coarse.system.dt <= 1.5 * march.system.dt:
            break
        errors = mean_squares(_differences(coarse, pairs, begin, span) - exact, fields)
        # This is also false for runs that have blown up.
        is_accurate = (errors <= TOLERANCE**2 * size).all()
        if is_accurate and is_stable_for_long(coarse, states[:1], begin, span):
            return coarse.system.dt
    return None


def is_stable_for_long(march: March, states: Array, begin: float, span: float) -> bool:
    """Return whether the steps do not amplify rounding errors over very many samples.

    Args:
        march: the simulator with these steps.
        states: beside which errors may grow, ``(state, field*point)``.
        begin: time at which they are.
        span: time between two samples.
    """
    times = torch.full((len(states),), begin, dtype=torch.float64)
    along = Along(march.on_grid(states), times, math.inf, DURATION * span)
    return is_stable(march.system, along)


def _differences(march: March, pairs: Array, begin: float, span: float) -> Array:
    """Return the differences of pairs of runs after some samples, ``(pair, field*point)``."""
    for sample in range(SAMPLES):
        pairs = march(pairs, begin + sample * span, span)
    found: Array = pairs[::2] - pairs[1::2]
    return found


def mean_squares(values: Array, fields: int) -> Array:
    """Return the mean square of each field, ``(field,)``."""
    found: Array = np.square(values).reshape(len(values), fields, -1).mean(axis=(0, 2))
    return found
