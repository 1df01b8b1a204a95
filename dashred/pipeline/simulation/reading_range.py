"""How far a simulation is from the range of the recording."""

from __future__ import annotations

import numpy as np
import torch
from torch import Tensor

from dashred.pipeline.problem import Problem


def distance_from_readings(problem: Problem, path: Tensor) -> Tensor:
    """Return how far simulated readings are from the recorded ones, ``(time,)``.

    The distance of a reading is that from the mean of its quantity over all fitted sensors and
    samples, in standard deviations of these. That of a sample is the largest of its readings; it is
    infinite where one of them is NaN.

    Args:
        problem: one episode.
        path: its simulation, ``(time, field, *grid)``.
    """
    fit = problem.split.fit
    simulated = problem.operator(fit)(path, problem.times[: len(path)].numpy())
    largest = torch.zeros(len(path), dtype=torch.float64)
    for quantity in {sensor.reads for sensor in fit.sensors}:
        mine = [j for j, sensor in enumerate(fit.sensors) if sensor.reads == quantity]
        values = fit.values[:, mine]
        std = max(float(np.nanstd(values)), 1e-12)
        away = (simulated[:, mine] - float(np.nanmean(values))).abs() / std
        largest = torch.maximum(largest, away.nan_to_num(torch.inf, torch.inf).amax(dim=1))
    return largest
