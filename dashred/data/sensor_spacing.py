"""Farthest-point sampling of sensors."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray


def farthest_points(
    positions: NDArray[np.float64],
    count: int,
    rng: np.random.Generator,
    *,
    candidates: Sequence[int],
    already_chosen: Sequence[int] = (),
) -> list[int]:
    """Choose ``count`` candidates, each as far as possible from those already chosen.

    The first candidate is random. Distances are measured on a torus whose period along each axis
    is the sensors' extent plus one mean spacing.

    Args:
        positions: of all sensors, shape ``(sensor, axis)``.
        count: number of candidates to choose.
        rng: draws the first candidate and breaks ties.
        candidates: indices of sensors that may be chosen.
        already_chosen: indices of further sensors to keep away from.
    """
    distances = _distances(positions)
    # Break ties at random, not by file order: all sensors of an ODE system are tied.
    distances = distances + 1e-9 * rng.random(len(positions))
    left = [int(index) for index in rng.permutation(candidates)]
    chosen: list[int] = []
    while len(chosen) < count:
        near = [*already_chosen, *chosen]
        best = max(left, key=lambda index: distances[near, index].min()) if near else left[0]
        left.remove(best)
        chosen.append(best)
    return chosen


def _distances(positions: NDArray[np.float64]) -> NDArray[np.float64]:
    squared = np.zeros((len(positions), len(positions)))
    for along in positions.T:
        places = len(np.unique(along))
        if places > 1:
            period = np.ptp(along) * places / (places - 1)
            apart = np.abs(along[:, None] - along[None, :]) / period
            squared += np.minimum(apart, 1.0 - apart) ** 2
    return np.sqrt(squared)
