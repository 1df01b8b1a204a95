"""A deterministic ensemble filter that also smooths the start and learns the model error.

The ensemble square-root filter of Whitaker & Hamill (Mon. Weather Rev. 130, 2002), which takes
uncorrelated observations one by one. What it updates is the state now, and with it through their
sample covariances the state at the record's first sample (a fixed-point smoother) and each
member's coefficients of model-error terms.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import torch
from jaxtyping import Float
from torch import Tensor

from dashred.data.observation_operator import ObservationOperator
from dashred.inference.initial_state.covariance_tapers import (
    distances,
    gaspari_cohn,
    sensor_distances,
)
from dashred.physics.library import resolve
from dashred.physics.solvers.compiled_simulator import compile_if_worthwhile
from dashred.physics.system import System, Term

FEWEST_LEFT = 0.5
# A member so many times larger than half of the others is blowing up: finite yet, but the sample's
# covariances would be its own alone, or overflow.
LARGEST = 1e3


class FilterLostError(Exception):
    """So many members have blown up that the others say nothing."""


@dataclass(frozen=True)
class FilterSettings:
    """How far the filter trusts its own sample covariances.

    With the defaults it is the exact Kalman filter of a linear system.

    Attributes:
        radius: Gaspari-Cohn radius around a sensor for the present state, in the axes' unit;
            infinite for none.
        start_radius: the same for the start, which a moving front asks to be wider.
        inflation: factor on the state's forecast anomalies before each analysis.
        damping: fraction of the gain that reaches the coefficients.
    """

    radius: float = math.inf
    start_radius: float = math.inf
    inflation: float = 1.0
    damping: float = 1.0


@dataclass(frozen=True)
class Filtered:
    """What the filter knows after the last sample.

    Anomalies are deviations from the mean: the covariance is ``AᵀA/(member − 1)``.

    Attributes:
        start_mean: of the state at the first sample, given all observations, ``(field, *grid)``.
        start_anomalies: ``(member, field, *grid)``.
        mean: of the state at the last sample, ``(field, *grid)``.
        anomalies: ``(member, field, *grid)``.
        coefficients_mean: ``(term,)``.
        coefficients_anomalies: ``(member, term)``.
        innovations: observation minus forecast, ``(time, sensor)``; NaN where missing.
        innovation_std: what the filter expected of them, ``(time, sensor)``.
        means: of the state at every sample, given the observations so far,
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
) -> Filtered:
    """Assimilate a record, sample by sample.

    Args:
        system: the simulator.
        members: states at ``times[0]``, before any observation.
        coefficients: of ``terms`` in each member; None: the simulator alone.
        terms: model-error terms.
        times: of the observations.
        values: observations; NaN is missing.
        operator: H of the sensors.
        noise: σ of each sensor.
        settings: localisation and inflation.

    Raises:
        FilterLostError: more than half of the members blow up.
    """
    if coefficients is None:
        terms, coefficients = (), members.new_zeros((len(members), 0))
    run = compile_if_worthwhile(
        system, resolve(system, terms), members, float(times[-1] - times[0])
    )
    tapers = _Tapers(system, operator, settings, coefficients.shape[1])
    states, starts = members, members
    innovations, stds = torch.full_like(values, torch.nan), torch.full_like(values, torch.nan)
    means = members.new_empty((len(times), *members.shape[1:]))
    for i in range(len(times)):
        if i:
            states = run(states, times[i - 1 : i + 1], coefficients)[:, -1]
            whole = _whole(states)
            _check_left(whole, len(members), float(times[i]))
            states, starts, coefficients = states[whole], starts[whole], coefficients[whole]
        centre = states.mean(dim=0)
        states = centre + settings.inflation * (states - centre)
        readings = operator(states, float(times[i]))
        joint = torch.cat([readings, states.flatten(1), starts.flatten(1), coefficients], dim=1)
        joint, innovations[i], stds[i] = _analyse(joint, values[i], noise, tapers.weights)
        states, starts, coefficients = tapers.split(joint)
        means[i] = states.mean(dim=0)
    parts = [_mean_and_anomalies(part) for part in (starts, states, coefficients)]
    return Filtered(*parts[0], *parts[1], *parts[2], innovations, stds, means)


class _Tapers:
    """The joint vector of one analysis: readings | state | start | coefficients.

    Attributes:
        weights: how much of the gain of each sensor reaches each entry, ``(sensor, entry)``.
    """

    def __init__(
        self, system: System, operator: ObservationOperator, settings: FilterSettings, terms: int
    ) -> None:
        self.fields, self.shape = len(system.fields), system.grid.shape
        sensors = len(operator.sensors)
        state = self.fields * math.prod(self.shape)
        self.sizes = [sensors, state, state, terms]
        self.weights = torch.ones((sensors, sum(self.sizes)), dtype=torch.float64)
        between, now, start, learnt = self.weights.split(self.sizes, dim=1)
        learnt *= settings.damping
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
        """Return states, starts and coefficients of all members."""
        _, states, starts, coefficients = joint.split(self.sizes, dim=1)
        shape = (len(joint), self.fields, *self.shape)
        return states.reshape(shape), starts.reshape(shape), coefficients


def _analyse(
    joint: Float[Tensor, "member entry"],
    values: Float[Tensor, " sensor"],
    noise: Float[Tensor, " sensor"],
    weights: Float[Tensor, "sensor entry"],
) -> tuple[Tensor, Tensor, Tensor]:
    """Take the observations of one time, one after the other.

    With h the reading's anomalies, ``k = ρ ∘ cov(x, h) / (var h + σ²)``, the mean moves by
    ``k (y − h̄)`` and the anomalies by ``−α k h``, ``α = 1/(1 + √(σ²/(var h + σ²)))``
    (Whitaker & Hamill 2002, eqs. 2 and 13): without localisation the exact posterior covariance.

    Returns:
        the joint vectors, the innovations ``y − h̄`` and their expected std, both as they were
        before this time's first observation.
    """
    mean, anomalies = _mean_and_anomalies(joint)
    freedom, sensors = len(joint) - 1, len(values)
    innovations = values - mean[:sensors]
    stds = (anomalies[:, :sensors].square().sum(dim=0) / freedom + noise**2).sqrt()
    for j in torch.nonzero(~values.isnan()).flatten().tolist():
        h = anomalies[:, j].clone()
        variance, error = h @ h / freedom, noise[j] ** 2
        gain = weights[j] * (h @ anomalies) / (freedom * (variance + error))
        alpha = 1 / (1 + (error / (variance + error)).sqrt())
        mean = mean + gain * (values[j] - mean[j])
        anomalies = torch.addr(anomalies, h, gain, alpha=-float(alpha))
    return mean + anomalies, innovations, stds


def _mean_and_anomalies(members: Tensor) -> tuple[Tensor, Tensor]:
    mean = members.mean(dim=0)
    return mean, members - mean


def _whole(states: Float[Tensor, "member field ..."]) -> Tensor:
    """Return which members have not blown up, and are not about to."""
    size = states.abs().flatten(1).amax(dim=1)
    half = size.nan_to_num(nan=torch.inf).median()
    return torch.isfinite(size) & ((size <= LARGEST * half) | (half == 0))


def _check_left(whole: Tensor, members: int, time: float) -> None:
    if int(whole.sum()) < max(2, FEWEST_LEFT * members):
        raise FilterLostError(
            f"of {members} members only {int(whole.sum())} are still whole at t = {time:g}"
        )
