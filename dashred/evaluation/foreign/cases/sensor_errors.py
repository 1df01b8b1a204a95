"""Errors of a sensor whose shapes are on no list of the analysis.

Each function returns a curve over the time of the record, scaled to a largest value of 1.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from dashred.evaluation.foreign.cases.case import Array

Shape = Callable[[Array, np.random.Generator], Array]

# Largest error in units of the std of the noise.
SIZES = (8.0, 20.0)
# Smoothing of a walk, as a share of the record.
WALK_MEMORY = 0.05


def random_walk(clock: Array, rng: np.random.Generator) -> Array:
    """Return a smooth random walk from 0; ``clock`` runs from 0 to 1."""
    steps = rng.standard_normal(len(clock))
    width = max(1, round(WALK_MEMORY * len(clock)))
    return np.cumsum(np.convolve(steps, np.ones(width) / width, mode="same"))


def step_and_recovery(clock: Array, rng: np.random.Generator) -> Array:
    """Return a sudden step that decays exponentially."""
    begin, decay = rng.uniform(0.15, 0.5), rng.uniform(0.1, 0.25)
    return np.where(clock >= begin, np.exp(-(clock - begin).clip(min=0) / decay), 0.0)


def growing_oscillation(clock: Array, rng: np.random.Generator) -> Array:
    """Return a slow oscillation whose amplitude grows with time."""
    cycles, phase = rng.uniform(2.2, 3.8), rng.uniform(0, 2 * np.pi)
    return clock * np.sin(2 * np.pi * cycles * clock + phase)


def intermittent_offset(clock: Array, rng: np.random.Generator) -> Array:
    """Return an offset that comes and goes two to four times."""
    count = int(rng.integers(2, 5))
    edges = np.sort(rng.uniform(0.05, 0.95, 2 * count))
    inside = np.searchsorted(edges, clock, side="right") % 2 == 1
    return inside.astype(np.float64)


SHAPES: dict[str, Shape] = {
    "wanders": random_walk,
    "steps and recovers": step_and_recovery,
    "oscillates more and more": growing_oscillation,
    "is offset now and then": intermittent_offset,
}


def draw_error(times: Array, noise: float, rng: np.random.Generator) -> tuple[str, Array]:
    """Return what the sensor does, and its error at the times of the record.

    Args:
        times: ``(time,)``.
        noise: std of the noise of the sensor.
        rng: random generator.
    """
    says = list(SHAPES)[int(rng.integers(len(SHAPES)))]
    clock = (times - times[0]) / (times[-1] - times[0])
    curve = SHAPES[says](clock, rng)
    size = rng.uniform(*SIZES) * noise * rng.choice([-1.0, 1.0])
    return says, size * curve / max(float(np.abs(curve).max()), 1e-300)
