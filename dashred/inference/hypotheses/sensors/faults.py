"""Which sensor is at fault, and how: bias, drift, stuck, spikes, or not where it is said to be.

A faulty sensor pulls the fit towards itself, so each is judged by the others: the start is fitted
without it, on the linearised problem, and its fault read off what then remains
(docs/method.md#sensor-faults).
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass, replace

import torch
from torch import Tensor

from dashred.inference.fit.least_squares import LeastSquaresProblem, NormalEquations
from dashred.inference.fit.levenberg_marquardt import FitResult, minimise
from dashred.inference.fit.normal_equations import solve
from dashred.inference.forward.sensor_block import OffsetErrors, PositionErrors, SensorErrors

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
    fitted: FitResult
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
    objective: LeastSquaresProblem, normal: NormalEquations, fault: Fault, states: Tensor
) -> Predicted:
    """Return what a fault would be, were the readings linear in the start and the law.

    Args:
        objective: F of a law.
        normal: linearised about its fit.
        fault: what may be wrong with one sensor.
        states: at that fit, ``(time, episode, field, *grid)``.
    """
    errors = _errors(objective, fault)
    kept = (~fault.samples).to(torch.float64)
    shape = objective.recorded.shape
    rows = torch.ones(shape, dtype=torch.float64)
    rows[:, fault.sensor] = kept
    weights = rows.flatten()
    jacobian, target = normal.jacobian * weights[:, None], normal.target * weights
    precision, own_numbers = normal.precision, 0
    if errors is not None:
        begin, columns, added = _about(_unseen(objective, fault), errors, states)
        target = target + (columns @ begin - added) * weights
        jacobian = torch.cat([jacobian, columns.to(jacobian.dtype)], dim=1)
        precision = torch.cat([precision, errors.scales**-2])
        own_numbers = len(errors.scales)
    goal = jacobian.T @ target
    hessian = jacobian.T @ jacobian + torch.diag(precision)
    phi = solve(hessian, goal[:, None])[:, 0]
    score = float(target.square().sum() - goal @ phi) + fault.constant
    first = len(phi) - own_numbers
    own = torch.eye(len(phi), dtype=hessian.dtype)[:, first:]
    stds = solve(hessian, own)[first:].diagonal().sqrt()
    return Predicted(score + _penalty(objective, fault), phi[first:], stds)


def predicted_faults(
    objective: LeastSquaresProblem, phi: Tensor, normal: NormalEquations, faults: Iterable[Fault]
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
    objective: LeastSquaresProblem, errors: SensorErrors, states: Tensor
) -> tuple[Tensor, Tensor, Tensor]:
    """Return a fault's own unknowns near which it is linear, and what it does to the readings.

    Returns:
        The unknowns, ``(number,)``; what one unit of each adds to the whitened readings about them,
        ``(time·sensor, number)``; and what they add themselves, ``(time·sensor,)``.
    """
    noise, stated = objective.noise, objective.forward_model.sensors.observe(states)
    begin = errors.first_guess(states, objective.recorded, noise.std)
    columns = noise.whiten(errors.columns(stated, states, begin).movedim(-1, 0)).flatten(1).T
    [moved] = errors.apply(stated[None], states[None], begin[None])
    return begin, columns, noise.whiten(moved - stated).flatten()


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
    mine, errors = _unseen(objective, fault), _errors(objective, fault)
    if errors is not None:
        forward_model = mine.forward_model
        sensors = replace(forward_model.sensors, errors=errors)
        mine = mine.with_unknowns(replace(forward_model, sensors=sensors), errors.scales)
    fitted = minimise(mine, torch.cat([phi, own]), STEPS, TOLERANCE)
    score = fitted.cost + fault.constant + _penalty(objective, fault)
    return FittedFault(fault, mine, fitted, score)


def _unseen(objective: LeastSquaresProblem, fault: Fault) -> LeastSquaresProblem:
    """Return F without the samples that are no readings."""
    seen = objective.noise.available.clone()
    seen[:, fault.sensor] &= ~fault.samples
    return replace(objective, noise=replace(objective.noise, available=seen))


def _errors(objective: LeastSquaresProblem, fault: Fault) -> SensorErrors | None:
    """Return the fault's own unknowns; None for one that only takes samples away."""
    forward_model, block = objective.forward_model, objective.forward_model.sensors
    own = block.columns_of(fault.sensor)
    if fault.kind == "misplaced":
        return PositionErrors(block.sensors[fault.sensor], own, forward_model.simulator.system)
    if fault.kind not in ("bias", "drift"):
        return None
    times = forward_model.times
    pattern = torch.zeros((1, *objective.recorded.shape), dtype=torch.float64)
    # A drift begins anew with every episode.
    passed = times - times[0]
    pattern[0, :, own] = passed / passed.max() if fault.kind == "drift" else 1.0
    # Of a trace in which nothing changes, the noise is all that tells how large an offset may be.
    traces = objective.recorded[:, own]
    size = traces[~traces.isnan()].std()
    return OffsetErrors(
        pattern, torch.where(size > 0, size, objective.noise.std[fault.sensor])[None]
    )
