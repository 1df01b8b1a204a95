"""Which sensor is at fault, and how: bias, drift, stuck, spikes, or not where it is said to be.

A faulty sensor pulls the fit towards itself, so each is judged by the others: the start is fitted
without it, on the linearised problem, and its fault read off what then remains (design §4.3.4).
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass, replace
from itertools import product

import torch
from torch import Tensor

from dashred.inference.fit.least_squares import LeastSquaresProblem, Normal
from dashred.inference.fit.levenberg_marquardt import Fitted, minimise
from dashred.inference.fit.normal_equations import solve
from dashred.inference.forward.faulty_sensor_model import (
    MovedSensorModel,
    SensorOffsetModel,
    columns_of,
)
from dashred.physics.grids.grid import Axis

# How far off a sensor may be, as a share of the axis, over what its readings are differentiated,
# and where it is looked for first: a front is narrower than what a sensor may be off.
MISPLACED, REACH = 0.03, 0.0005
SOUGHT = (0.0, 0.0025, 0.005, 0.01, 0.015, 0.02, 0.03, 0.045)
STEPS, TOLERANCE = 6, 1e-3


@dataclass(frozen=True)
class Fault:
    """One way in which one sensor may be at fault.

    Attributes:
        kind: ``bias``, ``drift``, ``stuck``, ``spikes`` or ``misplaced``.
        sensor: its index; of several episodes, in one of them.
        samples: that are no readings of the system at all, ``(time,)``; all False but for stuck
            sensors and spikes, which are of one episode alone.
        constant: what these samples add to F.
        parameters: how many numbers describe it.
    """

    kind: str
    sensor: int
    samples: Tensor
    constant: float = 0.0
    parameters: float = 1.0

    def penalty(self, samples: float, sensors: int) -> float:
        """Return what its freedom costs: ``parameters ln n + 2 ln(4·sensors)``."""
        return self.parameters * math.log(samples) + 2 * math.log(4 * sensors)


@dataclass(frozen=True)
class FittedFault:
    """A fault that was fitted together with the start and the law.

    Attributes:
        fault: which.
        objective: F, without the samples that are no readings.
        fitted: its minimum.
        score: ``F + constant + penalty``.
    """

    fault: Fault
    objective: LeastSquaresProblem
    fitted: Fitted
    score: float


@dataclass(frozen=True)
class Predicted:
    """A fault as the linearised problem sees it.

    Attributes:
        score: ``F + constant + penalty``, start and law at their best.
        own: the numbers that describe it, ``(number,)``; none of one that only takes samples away.
        stds: their posterior standard deviations.
    """

    score: float
    own: Tensor
    stds: Tensor


def predicted(
    objective: LeastSquaresProblem, normal: Normal, fault: Fault, states: Tensor
) -> Predicted:
    """Return what a fault would be, were the readings linear in the start and the law.

    Args:
        objective: F of a law.
        normal: linearised about its fit.
        fault: what may be wrong with one sensor.
        states: at that fit, ``(time, field, *grid)``.
    """
    mine, extra = _posed(objective, fault)
    kept = (~fault.samples).to(torch.float64)
    shape = objective.recorded.shape
    rows = torch.ones(shape, dtype=torch.float64)
    rows[:, fault.sensor] = kept
    weights = rows.flatten()
    jacobian, target = normal.jacobian * weights[:, None], normal.target * weights
    precision = normal.precision
    if extra:
        begin, columns, added = _about(mine, states, fault)
        target = target + (columns @ begin - added) * weights
        jacobian = torch.cat([jacobian, columns.to(jacobian.dtype)], dim=1)
        precision = torch.cat([precision, mine.prior_std[-extra:] ** -2])
    goal = jacobian.T @ target
    hessian = jacobian.T @ jacobian + torch.diag(precision)
    phi = solve(hessian, goal[:, None])[:, 0]
    score = float(target.square().sum() - goal @ phi) + fault.constant
    first = len(phi) - extra
    own = torch.eye(len(phi), dtype=hessian.dtype)[:, first:]
    stds = solve(hessian, own)[first:].diagonal().sqrt()
    return Predicted(score + _penalty(objective, fault), phi[first:], stds)


def predicted_faults(
    objective: LeastSquaresProblem, phi: Tensor, normal: Normal, faults: Iterable[Fault]
) -> list[tuple[Predicted, Fault]]:
    """Return what each fault would be.

    Args:
        objective: F of a law.
        phi: its fit.
        normal: linearised there.
        faults: those that are suspected.
    """
    [states] = objective.forward_model.states(*objective.split(phi[None]))
    return [(predicted(objective, normal, fault, states), fault) for fault in faults]


def _about(
    objective: LeastSquaresProblem, states: Tensor, fault: Fault
) -> tuple[Tensor, Tensor, Tensor]:
    """Return a fault's own unknowns near which it is linear, and what it does to the readings.

    Returns:
        The unknowns, ``(number,)``; what one unit of each adds to the whitened readings about them,
        ``(time·sensor, number)``; and what they add themselves, ``(time·sensor,)``.
    """
    forward_model, noise = objective.forward_model, objective.noise
    if isinstance(forward_model, SensorOffsetModel):
        columns = noise.whiten(forward_model.columns(states).movedim(-1, 0)).flatten(1).T
        return torch.zeros(columns.shape[1], dtype=torch.float64), columns, 0 * columns[:, 0]
    assert isinstance(forward_model, MovedSensorModel)
    own = columns_of(forward_model.operator.sensors, fault.sensor)
    begin = _sought(forward_model, objective.recorded[:, own], noise.std[fault.sensor], states)
    columns = noise.whiten(forward_model.columns(states, begin).movedim(-1, 0)).flatten(1).T
    moved = torch.zeros_like(objective.recorded)
    stated = forward_model.operator(states)[:, own]
    moved[:, own] = forward_model.at(states, begin[None]).reshape(stated.shape) - stated
    return begin, columns, noise.whiten(moved).flatten()


def _sought(
    forward_model: MovedSensorModel, trace: Tensor, sigma: Tensor, states: Tensor
) -> Tensor:
    """Return how far from its stated place a sensor would read about what it has read, ``(axis,)``.

    Args:
        forward_model: of which sensor.
        trace: what it has read, ``(time, column)``; NaN is missing.
        sigma: its noise.
        states: ``(time, field, *grid)``.
    """
    axes = forward_model.simulator.system.axes
    shares = sorted({sign * share for share in SOUGHT for sign in (-1.0, 1.0)}, key=abs)
    places = torch.tensor(list(product(shares, repeat=len(axes))), dtype=torch.float64)
    lengths = torch.tensor([axis.length for axis in axes], dtype=torch.float64)
    found = forward_model.at(states, places * lengths).reshape(*trace.shape, len(places))
    left = ((found - trace[..., None]) / sigma).flatten(0, 1)
    misfits = left.nan_to_num().square().sum(dim=0) + (places / MISPLACED).square().sum(dim=1)
    return places[int(misfits.argmin())] * lengths


def _penalty(objective: LeastSquaresProblem, fault: Fault) -> float:
    return fault.penalty(objective.noise.effective_count, objective.recorded.shape[1])


def fit_fault(
    objective: LeastSquaresProblem, fault: Fault, phi: Tensor, own: Tensor
) -> FittedFault:
    """Fit start, law and fault together.

    Args:
        objective: F of the law.
        fault: what is wrong with one sensor.
        phi: where the fit of start and law begins.
        own: where that of the numbers that describe the fault does, ``(number,)``.
    """
    mine, _ = _posed(objective, fault)
    fitted = minimise(mine, torch.cat([phi, own]), STEPS, TOLERANCE)
    score = fitted.cost + fault.constant + _penalty(objective, fault)
    return FittedFault(fault, mine, fitted, score)


def _posed(objective: LeastSquaresProblem, fault: Fault) -> tuple[LeastSquaresProblem, int]:
    """Return F with a fault, and how many unknowns this has of its own."""
    seen = objective.noise.seen.clone()
    seen[:, fault.sensor] &= ~fault.samples
    without = replace(objective, noise=replace(objective.noise, seen=seen))
    found = _parametrised(without, fault)
    return found or without, len(found.prior_std) - len(objective.prior_std) if found else 0


def _parametrised(objective: LeastSquaresProblem, fault: Fault) -> LeastSquaresProblem | None:
    """Return F with the fault's own unknowns; None for one that only takes samples away."""
    forward_model = objective.forward_model
    same = (
        forward_model.simulator,
        forward_model.start,
        forward_model.candidates,
        forward_model.operator,
    )
    if fault.kind == "misplaced":
        axes: tuple[Axis, ...] = forward_model.simulator.system.axes
        reach = tuple(REACH * axis.length for axis in axes)
        moved = MovedSensorModel(*same, forward_model.times, fault.sensor, reach)
        stds = torch.tensor([MISPLACED * axis.length for axis in axes], dtype=torch.float64)
        return replace(
            objective, forward_model=moved, prior_std=torch.cat([objective.prior_std, stds])
        )
    if fault.kind not in ("bias", "drift"):
        return None
    times = forward_model.times
    pattern = torch.zeros((1, *objective.recorded.shape), dtype=torch.float64)
    # A drift begins anew with every episode.
    passed = (times - times[0]).reshape(len(times), -1)
    own = columns_of(forward_model.operator.sensors, fault.sensor)
    pattern[0, :, own] = passed / passed.max() if fault.kind == "drift" else 1.0
    offset = SensorOffsetModel(*same, times, pattern)
    # Of a trace in which nothing changes, the noise is all that tells how large an offset may be.
    traces = objective.recorded[:, own]
    size = traces[~traces.isnan()].std()
    stds = torch.where(size > 0, size, objective.noise.std[fault.sensor])[None]
    return replace(
        objective, forward_model=offset, prior_std=torch.cat([objective.prior_std, stds])
    )
