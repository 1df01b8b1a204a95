"""A deterministic ensemble filter that also estimates the start and the model error.

This is the ensemble square-root filter of Whitaker & Hamill (Mon. Weather Rev. 130, 2002), with
serial processing of uncorrelated observations. It updates the present state. Through the sample
covariances it also updates the state at the first sample (a fixed-point smoother) and the
coefficients of model-error terms (state augmentation).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from dashred.core.budget import NEVER, Deadline
from dashred.data.observation_operator import ObservationOperator
from dashred.inference.initial_state.covariance_tapers import (
    distances,
    gaspari_cohn,
    sensor_distances,
)
from dashred.inference.initial_state.serial_analysis import analyse
from dashred.physics.solvers.compiled_simulator import compile_if_worthwhile
from dashred.physics.system import System, Term
from dashred.physics.terms.library import resolve

# The filter diverges if a smaller share of the members remains.
SMALLEST_SHARE = 0.5
# A member that exceeds the median size by this factor is blowing up. It may still be finite, but it
# would dominate the sample covariances, or they would overflow.
LARGEST = 1e3


class FilterLostError(Exception):
    """The filter has diverged: too many members have blown up."""


@dataclass(frozen=True)
class FilterSettings:
    """Localisation, inflation and damping of the filter.

    With the defaults, and for a linear system, the filter is the Kalman filter with the sample
    covariances.

    Attributes:
        radius: Gaspari–Cohn radius around a sensor for the present state, in the unit of the axes;
            infinite for no localisation.
        start_radius: radius for the start; a moving front needs a larger one.
        inflation: factor on the forecast anomalies of the state before each analysis.
        damping: factor on the gain of the coefficients.
    """

    radius: float = math.inf
    start_radius: float = math.inf
    inflation: float = 1.0
    damping: float = 1.0


@dataclass(frozen=True)
class FilterResult:
    """The analysis after the last sample.

    Anomalies are deviations from the mean. The covariance is ``AᵀA/(member − 1)``.

    Attributes:
        start_mean: mean state at the first sample, given all observations, ``(field, *grid)``.
        start_anomalies: anomalies of that state, ``(member, field, *grid)``.
        mean: mean state at the last sample, ``(field, *grid)``.
        anomalies: anomalies of that state, ``(member, field, *grid)``.
        coefficients_mean: mean coefficients, ``(term,)``.
        coefficients_anomalies: their anomalies, ``(member, term)``.
        innovations: observation minus forecast, ``(time, sensor)``; NaN where missing.
        innovation_std: expected std of the innovations, ``(time, sensor)``.
        means: mean state at every sample, given the observations up to it,
            ``(time, field, *grid)``.
    """

    start_mean: Tensor
    start_anomalies: Tensor
    mean: Tensor
    anomalies: Tensor
    coefficients_mean: Tensor
    coefficients_anomalies: Tensor
    innovations: Tensor
    innovation_std: Tensor
    means: Tensor


@torch.no_grad()
def ensemble_filter(
    system: System,
    members: Float[Tensor, "member field ..."],
    coefficients: Float[Tensor, "member term"] | None,
    terms: Sequence[Term],
    times: Float[Tensor, " time"],
    values: Float[Tensor, "time sensor"],
    operator: ObservationOperator,
    noise: Float[Tensor, " sensor"],
    settings: FilterSettings,
    deadline: Deadline = NEVER,
) -> FilterResult:
    """Assimilate a recording, sample by sample.

    Args:
        system: the simulator.
        members: states at ``times[0]``, before any observation.
        coefficients: coefficients of ``terms`` in each member; None without terms.
        terms: model-error terms.
        times: times of the observations.
        values: observations; NaN where missing.
        operator: H of the sensors.
        noise: σ of each sensor.
        settings: localisation, inflation and damping.
        deadline: time at which the filter ends.

    Raises:
        FilterLostError: more than half of the members blow up.
        OutOfTimeError: the deadline is over.
    """
    if coefficients is None:
        terms, coefficients = (), members.new_zeros((len(members), 0))
    run = compile_if_worthwhile(
        system, resolve(system, terms), members, float(times[-1] - times[0])
    )
    tapers = _Tapers(system, operator, settings, coefficients.shape[1])
    std, no_limits = np.ascontiguousarray(noise.numpy()), np.full(len(noise), np.inf)
    states, starts = members, members
    innovations, stds = torch.full_like(values, torch.nan), torch.full_like(values, torch.nan)
    means = members.new_empty((len(times), *members.shape[1:]))
    for i in range(len(times)):
        deadline.check()
        if i:
            states = run(states, times[i - 1 : i + 1], coefficients)[:, -1]
            bounded = bounded_members(states)
            _check_divergence(bounded, len(members), float(times[i]))
            states, starts, coefficients = states[bounded], starts[bounded], coefficients[bounded]
        centre = states.mean(dim=0)
        states = centre + settings.inflation * (states - centre)
        readings = operator(states, float(times[i]))
        joint = torch.cat([readings, states.flatten(1), starts.flatten(1), coefficients], dim=1)
        observed = np.ascontiguousarray(values[i].numpy())
        found = analyse(joint.numpy(), observed, std, tapers.weights.numpy(), no_limits)
        innovations[i], stds[i] = map(torch.from_numpy, found[:2])
        states, starts, coefficients = tapers.split(joint)
        means[i] = states.mean(dim=0)
    parts = [_mean_and_anomalies(part) for part in (starts, states, coefficients)]
    return FilterResult(*parts[0], *parts[1], *parts[2], innovations, stds, means)


class _Tapers:
    """Tapers of the augmented vector of an analysis: readings, state, start, coefficients.

    Attributes:
        weights: factor on the gain of each sensor for each entry, ``(sensor, entry)``.
    """

    def __init__(
        self, system: System, operator: ObservationOperator, settings: FilterSettings, terms: int
    ) -> None:
        self.fields, self.shape = len(system.fields), system.grid.shape
        sensors = len(operator.sensors)
        state = self.fields * math.prod(self.shape)
        self.sizes = [sensors, state, state, terms]
        self.weights = torch.ones((sensors, sum(self.sizes)), dtype=torch.float64)
        between, now, start, parameters = self.weights.split(self.sizes, dim=1)
        parameters *= settings.damping
        if not system.axes:
            return
        places = torch.tensor([s.position for s in operator.sensors], dtype=torch.float64)
        apart = distances(system.grid, places).expand(sensors, *self.shape).flatten(1)
        if math.isfinite(settings.radius):
            between *= gaspari_cohn(sensor_distances(system.grid, places), settings.radius)
            now *= gaspari_cohn(apart, settings.radius).repeat(1, self.fields)
        if math.isfinite(settings.start_radius):
            start *= gaspari_cohn(apart, settings.start_radius).repeat(1, self.fields)

    def split(self, joint: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        """Return the states, starts and coefficients of all members."""
        _, states, starts, coefficients = joint.split(self.sizes, dim=1)
        shape = (len(joint), self.fields, *self.shape)
        return states.reshape(shape), starts.reshape(shape), coefficients


def _mean_and_anomalies(members: Tensor) -> tuple[Tensor, Tensor]:
    mean = members.mean(dim=0)
    return mean, members - mean


def bounded_members(states: Float[Tensor, "member field ..."]) -> Tensor:
    """Return which members have not blown up and are not blowing up."""
    size = states.abs().flatten(1).amax(dim=1)
    half = size.nan_to_num(nan=torch.inf).median()
    return torch.isfinite(size) & ((size <= LARGEST * half) | (half == 0))


def _check_divergence(bounded: Tensor, members: int, time: float) -> None:
    if int(bounded.sum()) < max(2, SMALLEST_SHARE * members):
        raise FilterLostError(
            f"only {int(bounded.sum())} of {members} members have not blown up at t = {time:g}"
        )
