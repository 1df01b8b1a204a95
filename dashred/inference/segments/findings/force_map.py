"""The force that a law over segments leaves, over time."""

from __future__ import annotations

import numpy as np
import torch

from dashred.inference.hypotheses.forcing_map import ForcingMap
from dashred.inference.segments.selection.left_force import LeftForce


def force_map(left: LeftForce) -> ForcingMap | None:
    """Return the force in the first episode, one value per segment; None without error bars."""
    walking = left.walking
    problem, segments = walking.problem, walking.problem.segments
    fields, forced = problem.simulator.fields, list(problem.walks.forced)
    normal = problem.linearise(walking.fit.point, walking.members)
    covariance = None
    if normal is not None:
        covariance = normal.covariance(range(fields, fields + len(forced)))
    if covariance is None:
        return None
    variance = walking.misfit * np.einsum("kii->ki", covariance)
    mine = segments.episode == segments.episode[0]
    amplitudes, stds = (left.force / left.rate)[mine], np.zeros((int(mine.sum()), fields))
    stds[:, forced] = np.sqrt(np.maximum(variance[mine], 0)) / left.rate[forced]
    return ForcingMap(
        places=torch.zeros((1, 0), dtype=torch.float64),
        times=torch.from_numpy(segments.times[mine].mean(axis=1)),
        amplitudes=torch.from_numpy(amplitudes.T[:, None].copy()),
        stds=torch.from_numpy(stds.T[:, None].copy()),
        gain=left.gain,
    )
