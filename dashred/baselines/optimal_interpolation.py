"""Optimal interpolation: the best linear unbiased estimate of the field, sample by sample.

``û_t = ū_t + C_t Hᵀ (H C_t Hᵀ + R)⁻¹ (y_t − H ū_t)``, mean and covariance of what the simulator may
do at that time (Gandin 1963; Kalnay, *Atmospheric modeling, data assimilation and predictability*,
2003, section 5.4). It reads one sample at a time, and knows no more of the dynamics than the
covariance.
"""

from __future__ import annotations

import torch

from dashred.baselines.estimate import Estimated
from dashred.discovery.linear_estimate import linear_estimate
from dashred.physics.ensemble import Ensemble
from dashred.stages.problem import Problem


@torch.no_grad()
def optimal_interpolation(problem: Problem, ensemble: Ensemble) -> Estimated:
    """Return the estimate from the fit sensors.

    Args:
        problem: the recording.
        ensemble: plain simulations over the fit window, which give means and covariances.
    """
    fit = problem.split.fit
    operator, noise = problem.operator(fit), problem.noise_of(fit.names)
    values = torch.from_numpy(fit.values)
    found = []
    for i, time in enumerate(ensemble.times.tolist()):
        states = ensemble.states[:, i]
        readings = operator(states, time)[:, None]
        found.append(linear_estimate(states, readings, values[i, None], noise).mean)
    return Estimated(torch.stack(found), None, f"{len(ensemble.states)} members")
