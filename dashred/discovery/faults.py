"""Which sensor is at fault, and how: bias, drift, stuck, spikes, or not where it is said to be.

A faulty sensor pulls the fit towards itself, so each is judged by the others: the start is fitted
without it, on the linearised problem, and its fault read off what then remains (design §4.3.4).
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import torch
from torch import Tensor

from dashred.discovery.faulty_shooting import MovedShooting, OffsetShooting
from dashred.discovery.gauss_newton import Fitted, minimise
from dashred.discovery.law import SensorFault
from dashred.discovery.objective import Normal, Objective
from dashred.physics.grid import Axis

# A sample this many σ off what the other sensors and neighbours say is a spike.
SPIKE = 5.0
# A stuck sensor's readings scatter by less than this share of the trace's std.
STILL, LEAST_STUCK = 0.02, 6
# How far off a sensor may be, as a share of the axis, and over what its weights are smooth.
MISPLACED, REACH = 0.03, 0.005
STEPS, TOLERANCE = 6, 1e-3


@dataclass(frozen=True)
class Fault:
    """One way in which one sensor may be at fault.

    Attributes:
        kind: ``bias``, ``drift``, ``stuck``, ``spikes`` or ``misplaced``.
        sensor: its index.
        samples: that are no readings of the system at all, ``(time,)``; all False but for stuck
            sensors and spikes.
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
class TestedFault:
    """A fault that was fitted together with the start and the law.

    Attributes:
        fault: which.
        objective: F, without the samples that are no readings.
        fitted: its minimum.
        score: ``F + constant + penalty``.
    """

    fault: Fault
    objective: Objective
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


def suspects(objective: Objective, normal: Normal) -> Iterator[Fault]:
    """Yield the faults that each sensor may have, by what the other sensors say of it.

    Args:
        objective: F of a law that may be right.
        normal: linearised about its fit.
    """
    shape = objective.recorded.shape
    seen = objective.noise.seen
    none = torch.zeros(shape[0], dtype=torch.bool)
    for sensor in range(shape[1]):
        rest = _without(objective, normal, sensor)
        yield Fault("bias", sensor, none)
        yield Fault("drift", sensor, none)
        if objective.shooting.simulator.system.axes:
            yield Fault("misplaced", sensor, none)
        sigma = float(objective.noise.std[sensor])
        yield from _stuck(objective, sensor)
        spikes = seen[:, sensor] & (rest.abs() > SPIKE * sigma) & _alone(rest, sigma)
        if spikes.any():
            groups = int((spikes & ~torch.cat([none[:1], spikes[:-1]])).sum())
            yield Fault("spikes", sensor, spikes, parameters=1.5 * groups)


def predicted(objective: Objective, normal: Normal, fault: Fault, states: Tensor) -> Predicted:
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
        columns = mine.noise.whiten(_columns(mine, states).movedim(-1, 0)).flatten(1).T
        jacobian = torch.cat([jacobian, columns.to(jacobian.dtype)], dim=1)
        precision = torch.cat([precision, mine.prior_std[-extra:] ** -2])
    goal = jacobian.T @ target
    hessian = jacobian.T @ jacobian + torch.diag(precision)
    phi = torch.linalg.solve(hessian, goal)
    score = float(target.square().sum() - goal @ phi) + fault.constant
    first = len(phi) - extra
    own = torch.eye(len(phi), dtype=hessian.dtype)[:, first:]
    stds = torch.linalg.solve(hessian, own)[first:].diagonal().sqrt()
    return Predicted(score + _penalty(objective, fault), phi[first:], stds)


def predicted_faults(
    objective: Objective, phi: Tensor, normal: Normal, faults: Sequence[Fault]
) -> list[tuple[Predicted, Fault]]:
    """Return what each fault would be.

    Args:
        objective: F of a law.
        phi: its fit.
        normal: linearised there.
        faults: those that are suspected.
    """
    [states] = objective.shooting.states(*objective.split(phi[None]))
    return [(predicted(objective, normal, fault, states), fault) for fault in faults]


def _columns(objective: Objective, states: Tensor) -> Tensor:
    """Return what one unit of the fault's own unknowns adds to the readings."""
    shooting = objective.shooting
    assert isinstance(shooting, OffsetShooting | MovedShooting)
    return shooting.columns(states)


def _penalty(objective: Objective, fault: Fault) -> float:
    return fault.penalty(objective.noise.effective_count, objective.recorded.shape[1])


def fit_fault(objective: Objective, fault: Fault, phi: Tensor) -> TestedFault:
    """Fit start, law and fault together.

    Args:
        objective: F of the law.
        fault: what is wrong with one sensor.
        phi: where the fit begins.
    """
    mine, extra = _posed(objective, fault)
    begin = torch.cat([phi, torch.zeros(extra, dtype=torch.float64)])
    fitted = minimise(mine, begin, STEPS, TOLERANCE)
    score = fitted.cost + fault.constant + _penalty(objective, fault)
    return TestedFault(fault, mine, fitted, score)


def _posed(objective: Objective, fault: Fault) -> tuple[Objective, int]:
    """Return F with a fault, and how many unknowns this has of its own."""
    seen = objective.noise.seen.clone()
    seen[:, fault.sensor] &= ~fault.samples
    without = replace(objective, noise=replace(objective.noise, seen=seen))
    found = _parametrised(without, fault)
    return found or without, len(found.prior_std) - len(objective.prior_std) if found else 0


def describe_fitted(objective: Objective, tested: TestedFault) -> SensorFault:
    """Return what was found to be wrong with the sensor of a fitted fault, in the user's units."""
    first = objective.modes + len(objective.prior_std)
    normal = tested.objective.linearise(tested.fitted.phi, tested.fitted.readings)
    stds = normal.covariance(range(len(tested.fitted.phi))).diagonal().sqrt()
    return describe(objective, tested.fault, tested.fitted.phi[first:], stds[first:])


def describe(objective: Objective, fault: Fault, own: Tensor, stds: Tensor) -> SensorFault:
    """Return what is wrong with a sensor, in the user's units.

    Args:
        objective: F of the law.
        fault: what it is.
        own: the numbers that describe it, ``(number,)``.
        stds: their standard deviations.
    """
    times = objective.shooting.times
    name = objective.shooting.operator.sensors[fault.sensor].name
    if not len(own):
        if fault.kind == "spikes":
            return SensorFault(fault.kind, name, float(fault.samples.sum()), None, None)
        tail = objective.recorded[fault.samples, fault.sensor]
        begin = float(times[int(torch.nonzero(fault.samples)[0])])
        return SensorFault(fault.kind, name, float(tail.nanmean()), None, begin)
    length = float(times[-1] - times[0]) if fault.kind == "drift" else 1.0
    value = float(own[0]) if len(own) == 1 else float(own.norm())
    return SensorFault(fault.kind, name, value / length, float(stds.norm()) / length, None)


def _parametrised(objective: Objective, fault: Fault) -> Objective | None:
    """Return F with the fault's own unknowns; None for one that only takes samples away."""
    shooting = objective.shooting
    same = shooting.simulator, shooting.start, shooting.candidates, shooting.operator
    trace = objective.recorded[:, fault.sensor]
    size = float(trace[~trace.isnan()].std())
    if fault.kind == "misplaced":
        axes: tuple[Axis, ...] = shooting.simulator.system.axes
        reach = tuple(REACH * axis.length for axis in axes)
        moved = MovedShooting(*same, shooting.times, fault.sensor, reach)
        stds = torch.tensor([MISPLACED * axis.length for axis in axes], dtype=torch.float64)
        return replace(objective, shooting=moved, prior_std=torch.cat([objective.prior_std, stds]))
    if fault.kind not in ("bias", "drift"):
        return None
    times = shooting.times
    pattern = torch.zeros((1, *objective.recorded.shape), dtype=torch.float64)
    ramp = (times - times[0]) / (times[-1] - times[0])
    pattern[0, :, fault.sensor] = ramp if fault.kind == "drift" else 1.0
    offset = OffsetShooting(*same, times, pattern)
    stds = torch.tensor([size], dtype=torch.float64)
    return replace(objective, shooting=offset, prior_std=torch.cat([objective.prior_std, stds]))


def _without(objective: Objective, normal: Normal, sensor: int) -> Tensor:
    """Return what one sensor reads beyond what the others let expect, in its unit, ``(time,)``."""
    shape = objective.recorded.shape
    jacobian = normal.jacobian.reshape(*shape, -1)
    target = normal.target.reshape(shape)
    others = [s for s in range(shape[1]) if s != sensor]
    rows, goal = jacobian[:, others].flatten(0, 1), target[:, others].flatten()
    matrix = rows.T @ rows + torch.diag(normal.precision)
    phi = torch.linalg.solve(matrix, rows.T @ goal)
    left = target[:, sensor] - jacobian[:, sensor] @ phi
    found: Tensor = left * objective.noise.std[sensor]
    return found


def _alone(rest: Tensor, sigma: float) -> Tensor:
    """Tell which samples stick out of their neighbours, too: a law's error is smooth in time."""
    before = torch.cat([rest[1:2], rest[:-1]])
    after = torch.cat([rest[1:], rest[-2:-1]])
    return (rest - (before + after) / 2).abs() > SPIKE * sigma


def _stuck(objective: Objective, sensor: int) -> Iterator[Fault]:
    """Yield the time from which on a sensor repeats itself, if it does."""
    trace = objective.recorded[:, sensor]
    known = torch.nonzero(~trace.isnan()).flatten()
    if len(known) < 2 * LEAST_STUCK:
        return
    values = trace[known]
    size, sigma = float(values.std()), float(objective.noise.std[sensor])
    first = len(values)
    # A sensor that gives up keeps its last value to the end, with the noise of reading it or not.
    for begin in range(len(values) - LEAST_STUCK, 0, -1):
        tail = values[begin:]
        if float(tail.std()) > max(STILL * size, 1.3 * sigma):
            break
        first = begin
    if first == len(values) or size <= 3 * sigma:
        return
    samples = torch.zeros(len(trace), dtype=torch.bool)
    samples[known[first:]] = True
    tail = values[first:]
    constant = float(((tail - tail.mean()) / sigma).square().sum())
    yield Fault("stuck", sensor, samples, constant, 2.0)
