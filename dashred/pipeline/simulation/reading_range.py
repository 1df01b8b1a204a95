"""How far a simulation is from the range of the recording."""

from __future__ import annotations

import numpy as np
import torch
from torch import Tensor

from dashred.pipeline.problem import Problem

# Share of the readings on either side that does not count as range: it may be spikes of a sensor.
OUTSIDE = 0.01


def distance_from_readings(problem: Problem, path: Tensor) -> Tensor:
    """Return how far simulated readings are from the recorded ones, ``(time,)``.

    The distance of a reading is that from the mean of its quantity over all fitted sensors and
    samples, in standard deviations of these. It is 0 between the quantiles of 1 % and 99 %, so that
    rare pulses that were recorded count as near, and infinite for NaN. The standard deviation is at
    least the noise σ, in case a quantity is constant. The distance of a sample is the largest of
    its readings; a quantity that the episode does not read has none.

    Args:
        problem: one episode.
        path: its simulation, ``(time, field, *grid)``.
    """
    fit, noise = problem.split.fit, problem.fit_noise_std()
    simulated = problem.operator(fit)(path, problem.times[: len(path)].numpy())
    largest = torch.where(simulated.isfinite(), 0.0, torch.inf).amax(dim=1)
    for quantity in {sensor.reads for sensor in fit.sensors}:
        mine = [j for j, sensor in enumerate(fit.sensors) if sensor.reads == quantity]
        known = fit.values[:, mine]
        known = known[np.isfinite(known)]
        if not known.size:
            continue
        read, std = simulated[:, mine], max(float(known.std()), float(noise[mine].max()), 1e-12)
        low, high = np.quantile(known, (OUTSIDE, 1 - OUTSIDE))
        is_outside = (read < low) | (read > high)
        away = torch.where(is_outside, (read - float(known.mean())).abs() / std, 0.0)
        largest = torch.maximum(largest, away.amax(dim=1))
    return largest
