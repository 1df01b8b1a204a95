"""Optimal interpolation: the best linear unbiased estimate of the field, sample by sample.

``û_t = ū_t + C_t Hᵀ (H C_t Hᵀ + R)⁻¹ (y_t − H ū_t)``, with mean and covariance of the ensemble at
that time (Gandin 1963; Kalnay, *Atmospheric modeling, data assimilation and predictability*,
2003, section 5.4). It uses one sample at a time; the covariance is its only
information about the dynamics. The sample covariance is tapered with distance, as in the filter.
The radius maximises the likelihood of the departures ``y_t − H ū_t``.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import torch
from jaxtyping import Float
from torch import Tensor

from dashred.data.sensors import Sensor
from dashred.evaluation.baselines.estimate import Estimate
from dashred.evaluation.baselines.localisation import radii, radius_text
from dashred.inference.initial_state.covariance_tapers import (
    distances,
    gaspari_cohn,
    sensor_distances,
)
from dashred.physics.grids.grid import Grid
from dashred.physics.grids.mesh import Mesh
from dashred.physics.runs.ensemble import Ensemble
from dashred.pipeline.problem import Problem


@dataclass(frozen=True)
class Taper:
    """Taper of the sample covariance.

    Attributes:
        radius: Gaspari-Cohn radius in units of the axes; infinite for no taper.
        readings: taper between sensors, ``(sensor, sensor)``.
        field: taper from every sensor, ``(sensor, *grid)``.
    """

    radius: float
    readings: Tensor
    field: Tensor

    @classmethod
    def of(cls, grid: Grid | Mesh, sensors: Sequence[Sensor], radius: float) -> Taper:
        """Return the taper for these sensors."""
        count = len(sensors)
        if math.isinf(radius):
            ones = torch.ones((count, count), dtype=torch.float64)
            return cls(radius, ones, torch.ones((count, *grid.shape), dtype=torch.float64))
        places = torch.tensor([sensor.position for sensor in sensors], dtype=torch.float64)
        between, apart = sensor_distances(grid, places), distances(grid, places)
        return cls(radius, gaspari_cohn(between, radius), gaspari_cohn(apart, radius))


@torch.no_grad()
def optimal_interpolation(problem: Problem, ensemble: Ensemble) -> Estimate:
    """Return the estimate from the fit sensors.

    Args:
        problem: the recording.
        ensemble: plain simulations over the fit window, for means and covariances.
    """
    fit = problem.split.fit
    operator, noise = problem.operator(fit), problem.noise_of(fit.names)
    values = torch.from_numpy(fit.values)
    grid = problem.system.grid
    tapers = [Taper.of(grid, operator.sensors, radius) for radius in radii(problem)]
    cost = [0.0] * len(tapers)
    found: list[list[Tensor]] = [[] for _ in tapers]
    for i, time in enumerate(ensemble.times.tolist()):
        states = ensemble.states[:, i]
        readings = operator(states, time)
        for j, taper in enumerate(tapers):
            estimate, added_cost = best_linear(states, readings, values[i], noise, taper)
            cost[j] += added_cost
            found[j].append(estimate)
    best = min(range(len(tapers)), key=lambda j: cost[j])
    radius = radius_text(tapers[best].radius)
    return Estimate(torch.stack(found[best]), None, f"{len(ensemble.states)} members, {radius}")


def best_linear(
    states: Float[Tensor, "member field ..."],
    readings: Float[Tensor, "member sensor"],
    values: Float[Tensor, " sensor"],
    noise: Float[Tensor, " sensor"],
    taper: Taper,
) -> tuple[Tensor, float]:
    """Return ``ū + (ρ∘C_uy)(ρ∘C_yy + R)⁻¹(y − ȳ)``, and −ln of the likelihood of ``y − ȳ``.

    Args:
        states: states of the ensemble.
        readings: noise-free readings of its members.
        values: recorded values; NaN where missing.
        noise: σ of each sensor.
        taper: the taper ρ.
    """
    known = ~values.isnan()
    mean, read = states.mean(dim=0), readings[:, known]
    anomalies, departures = states - mean, read - read.mean(dim=0)
    freedom = len(states) - 1
    innovation = values[known] - read.mean(dim=0)
    expected = taper.readings[known][:, known] * (departures.T @ departures) / freedom
    root = torch.linalg.cholesky(expected + noise[known].square().diag())
    weights = torch.cholesky_solve(innovation[:, None], root)[:, 0]
    covariance = torch.einsum("ms,mf...->sf...", departures, anomalies) / freedom
    shift = torch.einsum("s,sf...->f...", weights, covariance * taper.field[known][:, None])
    log_likelihood = -root.diagonal().log().sum() - innovation @ weights / 2
    return mean + shift, -float(log_likelihood)
