"""The force that no law over segments expresses, over time."""

from __future__ import annotations

import numpy as np
import torch

from dashred.inference.hypotheses.forcing_map import ForcingMap
from dashred.inference.segments.selection.search import SegmentSearch


def force_map(search: SegmentSearch) -> ForcingMap | None:
    """Return the force in the first episode, one value per segment; None if there is none.

    Args:
        search: the laws, and the force beside one of them or beside none.
    """
    walking = search.force
    if walking is None:
        return None
    problem, point = walking.problem, walking.fit.point
    segments, fields = problem.segments, problem.simulator.fields
    forced = list(problem.walks.forced)
    normal = problem.linearise(point, walking.members)
    covariance = None
    if normal is not None:
        covariance = normal.covariance(range(fields, fields + len(forced)))
    if covariance is None:
        return None
    variance = walking.misfit * np.einsum("kii->ki", covariance)
    rate, mine = search.natural.rate, segments.episode == segments.episode[0]
    amplitudes, stds = np.zeros((2, fields, 1, int(mine.sum())))
    for place, equation in enumerate(forced):
        amplitudes[equation, 0] = point.walked[mine, place] / rate[equation]
        stds[equation, 0] = np.sqrt(np.maximum(variance[mine, place], 0)) / rate[equation]
    return ForcingMap(
        places=torch.zeros((1, 0), dtype=torch.float64),
        times=torch.from_numpy(segments.times[mine].mean(axis=1)),
        amplitudes=torch.from_numpy(amplitudes),
        stds=torch.from_numpy(stds),
        gain=search.force_gain,
    )
