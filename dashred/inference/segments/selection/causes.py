"""Causes that are no law: a force in one equation, the error of one sensor, and their levels.

A level is a choice of the standard deviations of the cause's walk.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass
from typing import Literal

import numpy as np

from dashred.inference.segments.segments import Array
from dashred.inference.segments.walks import Walks
from dashred.inference.segments.weak_constraint import WeakConstraintProblem

# Used in place of a standard deviation of zero, as a share of the unit, to keep the prior regular.
ZERO = 1e-5
# Increments of a force from segment to segment, in units of the rms tendency of its equation.
FORCE_STEPS = (0.003, 0.01, 0.03, 0.1, 0.3, 1.0)
# Increments of a sensor's error from segment to segment, and of the change that its slope makes
# over a segment, in units of σ.
ERROR_STEPS = ((0.0, 0.1), (0.0, 0.3), (0.0, 1.0), (1.0, 0.1), (3.0, 0.1), (10.0, 0.3))


@dataclass(frozen=True)
class Level:
    """Standard deviations of a cause's components.

    Attributes:
        name: ``force``, or the kind of the sensor's fault.
        first: in an episode's first segment, ``(component,)``.
        increment: of their increments, ``(component,)``; 0 for none.
    """

    name: str
    first: tuple[float, ...]
    increment: tuple[float, ...]


@dataclass(frozen=True)
class Cause:
    """A force in an equation or the error of a sensor.

    Attributes:
        kind: which of them.
        index: of the equation or of the sensor.
        unit: of each component, ``(component,)``.
        levels: to choose from.
    """

    kind: Literal["force", "error"]
    index: int
    unit: tuple[float, ...]
    levels: tuple[Level, ...]


def possible_forces(rate: Array, equations: Collection[int]) -> list[Cause]:
    """Return a force in each of some equations.

    Args:
        rate: rms tendency of every field, ``(field,)``.
        equations: their indices.
    """
    return [
        Cause(
            "force",
            field,
            (size,),
            tuple(Level("force", (size,), (step * size,)) for step in FORCE_STEPS),
        )
        for field, size in enumerate(rate.tolist())
        if field in equations
    ]


def possible_errors(problem: WeakConstraintProblem) -> list[Cause]:
    """Return the error of every sensor; none of a single one: nothing contradicts it."""
    readings, segments = problem.segments.readings, problem.segments
    count = readings.shape[-1]
    if count < 2:
        return []
    stds = np.nanstd(readings.reshape(-1, count), axis=0).tolist()
    duration = float(np.ptp(segments.times))
    return [
        _error(sensor, max(std, sigma), sigma, segments.span, duration)
        for sensor, (std, sigma) in enumerate(zip(stds, problem.noise_std.tolist(), strict=True))
    ]


def _error(sensor: int, std: float, sigma: float, span: float, duration: float) -> Cause:
    levels = [
        Level("bias", (std, 0.0), (0.0, 0.0)),
        Level("drift", (std, std / duration), (0.0, 0.0)),
    ]
    for step, bend in ERROR_STEPS:
        slope = bend * sigma / span
        first = std, max(slope, std / duration)
        levels.append(Level("wandering", first, (step * sigma, slope)))
    return Cause("error", sensor, (sigma, sigma / span), tuple(levels))


def walks_of(chosen: Mapping[Cause, Level]) -> Walks:
    """Return the walks of some causes at their levels."""
    forces = [cause for cause in chosen if cause.kind == "force"]
    errors = [cause for cause in chosen if cause.kind == "error"]
    first, increment = [], []
    for cause in (*forces, *errors):
        level = chosen[cause]
        units = zip(cause.unit, level.first, level.increment, strict=True)
        for unit, begin, step in units:
            first.append(max(begin, ZERO * unit))
            increment.append(max(step, ZERO * unit))
    return Walks(
        tuple(cause.index for cause in forces),
        tuple(cause.index for cause in errors),
        np.array(first),
        np.array(increment),
    )
