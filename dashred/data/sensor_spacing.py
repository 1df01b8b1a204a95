"""Choosing sensors that lie far from each other."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray


def spread_out(
    positions: NDArray[np.float64],
    count: int,
    rng: np.random.Generator,
    *,
    candidates: Sequence[int],
    beside: Sequence[int] = (),
) -> list[int]:
    """Choose ``count`` of the candidates, each as far as possible from those chosen before it.

    Farthest-point sampling from a random start, with distances on a torus whose period along
    each axis is the sensors' extent plus one mean spacing.

    Args:
        positions: of all sensors, shape (sensor, axis).
        count: how many to choose.
        rng: decides the start and breaks ties.
        candidates: indices of sensors that may be chosen.
        beside: indices of sensors to keep away from, too.
    """
    distances = _distances(positions)
    # Ties (all of an ODE's sensors, for one) are broken at random, not by order in the file.
    distances = distances + 1e-9 * rng.random(len(positions))
    left = [int(index) for index in rng.permutation(candidates)]
    chosen: list[int] = []
    while len(chosen) < count:
        near = [*beside, *chosen]
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
