"""Sensor faults: bias, drift, stuck, spikes or a wrong position.

A faulty sensor pulls the fit towards its own readings. Each sensor is therefore judged by the
others: the linearised fit is repeated without it, and its fault is estimated from the remaining
residual (docs/method.md#sensor-faults).
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
    """A possible fault of one sensor.

    Attributes:
        kind: ``bias``, ``drift``, ``stuck``, ``spikes`` or ``misplaced``.
        sensor: index of the sensor; with several episodes, of its column in one of them.
        samples: mask of the samples that are not readings of the system, ``(time,)``. All are False
            except for stuck sensors and spikes, which occur in one episode only.
        constant: contribution of these samples to F.
        parameter_count: number of parameters that describe the fault.
    """

    kind: str
    sensor: int
    samples: Tensor
    constant: float = 0.0
    parameter_count: float = 1.0

    def penalty(self, samples: float, sensors: int) -> float:
        """Return the penalty for its degrees of freedom: ``k ln n + 2 ln(4·sensors)``."""
        return self.parameter_count * math.log(samples) + 2 * math.log(4 * sensors)


@dataclass(frozen=True)
class FittedFault:
    """A fault that was fitted together with the initial state and the law.

    Attributes:
        fault: the fault.
        objective: F, without the samples that are not readings.
        fitted: the minimum of F.
        score: ``F + constant + penalty``.
    """

    fault: Fault
    objective: LeastSquaresProblem
    fitted: FitResult
    score: float


@dataclass(frozen=True)
class FaultPrediction:
    """A fault as predicted by the linearised problem.

    Attributes:
        score: ``F + constant + penalty`` at the minimum over initial state, law and fault.
        parameters: parameters of the fault, ``(parameter,)``; empty if it only removes samples.
        stds: their posterior standard deviations, ``(parameter,)``.
    """

    score: float
    parameters: Tensor
    stds: Tensor


def predict_fault(
    objective: LeastSquaresProblem, normal: NormalEquations, fault: Fault, states: Tensor
) -> FaultPrediction:
    """Predict the parameters and the score of a fault from the linearised problem.

    Args:
        objective: F of a law.
        normal: F linearised about its fit.
        fault: the fault.
        states: states of that fit, ``(time, episode, field, *grid)``.
    """
    errors = _build_errors(objective, fault)
    is_reading = (~fault.samples).to(torch.float64)
    shape = objective.recorded.shape
    rows = torch.ones(shape, dtype=torch.float64)
    rows[:, fault.sensor] = is_reading
    weights = rows.flatten()
    jacobian, target = normal.jacobian * weights[:, None], normal.target * weights
    precision, parameter_count = normal.precision, 0
    if errors is not None:
        first_guess, columns, added = _linearise_errors(
            _without_fault_samples(objective, fault), errors, states
        )
        target = target + (columns @ first_guess - added) * weights
        jacobian = torch.cat([jacobian, columns.to(jacobian.dtype)], dim=1)
        precision = torch.cat([precision, errors.scales**-2])
        parameter_count = len(errors.scales)
    goal = jacobian.T @ target
    hessian = jacobian.T @ jacobian + torch.diag(precision)
    phi = solve(hessian, goal[:, None])[:, 0]
    score = float(target.square().sum() - goal @ phi) + fault.constant
    first = len(phi) - parameter_count
    unit_vectors = torch.eye(len(phi), dtype=hessian.dtype)[:, first:]
    stds = solve(hessian, unit_vectors)[first:].diagonal().sqrt()
    return FaultPrediction(score + _penalty(objective, fault), phi[first:], stds)


def predict_faults(
    objective: LeastSquaresProblem, phi: Tensor, normal: NormalEquations, faults: Iterable[Fault]
) -> list[tuple[FaultPrediction, Fault]]:
    """Predict the parameters and the score of each fault.

    Args:
        objective: F of a law.
        phi: its fit, ``(unknown,)``.
        normal: F linearised about this fit.
        faults: the suspected faults.
    """
    [states] = objective.forward_model.states(*objective.split(phi[None]))
    return [(predict_fault(objective, normal, fault, states), fault) for fault in faults]


def _linearise_errors(
    objective: LeastSquaresProblem, errors: SensorErrors, states: Tensor
) -> tuple[Tensor, Tensor, Tensor]:
    """Linearise the effect of a fault on the whitened readings about a first guess.

    Returns:
        The first guess of the parameters, ``(parameter,)``; the derivative of the readings by them,
        ``(time·sensor, parameter)``; and the effect of the first guess, ``(time·sensor,)``.
    """
    noise, stated = objective.noise, objective.forward_model.sensors.observe(states)
    first_guess = errors.first_guess(states, objective.recorded, noise.std)
    columns = noise.whiten(errors.columns(stated, states, first_guess).movedim(-1, 0)).flatten(1).T
    [shifted] = errors.apply(stated[None], states[None], first_guess[None])
    return first_guess, columns, noise.whiten(shifted - stated).flatten()


def _penalty(objective: LeastSquaresProblem, fault: Fault) -> float:
    return fault.penalty(objective.noise.effective_count, objective.recorded.shape[1])


def fit_fault(
    objective: LeastSquaresProblem, fault: Fault, phi: Tensor, parameters: Tensor
) -> FittedFault:
    """Fit initial state, law and fault together.

    Args:
        objective: F of the law.
        fault: the fault.
        phi: initial state and law at which the fit begins, ``(unknown,)``.
        parameters: parameters of the fault at which it begins, ``(parameter,)``.
    """
    problem, errors = _without_fault_samples(objective, fault), _build_errors(objective, fault)
    if errors is not None:
        forward_model = problem.forward_model
        sensors = replace(forward_model.sensors, errors=errors)
        problem = problem.with_unknowns(replace(forward_model, sensors=sensors), errors.scales)
    fitted = minimise(problem, torch.cat([phi, parameters]), STEPS, TOLERANCE)
    score = fitted.cost + fault.constant + _penalty(objective, fault)
    return FittedFault(fault, problem, fitted, score)


def _without_fault_samples(objective: LeastSquaresProblem, fault: Fault) -> LeastSquaresProblem:
    """Return F without the samples that are not readings."""
    seen = objective.noise.available.clone()
    seen[:, fault.sensor] &= ~fault.samples
    return replace(objective, noise=replace(objective.noise, available=seen))


def _build_errors(objective: LeastSquaresProblem, fault: Fault) -> SensorErrors | None:
    """Return the sensor errors of a fault; None if it only removes samples."""
    forward_model, block = objective.forward_model, objective.forward_model.sensors
    columns = block.columns_of(fault.sensor)
    if fault.kind == "misplaced":
        return PositionErrors(block.sensors[fault.sensor], columns, forward_model.simulator.system)
    if fault.kind not in ("bias", "drift"):
        return None
    times = forward_model.times
    pattern = torch.zeros((1, *objective.recorded.shape), dtype=torch.float64)
    # A drift starts from zero in every episode.
    elapsed = times - times[0]
    pattern[0, :, columns] = elapsed / elapsed.max() if fault.kind == "drift" else 1.0
    # A trace may be constant. Then only the noise tells how large an offset may be.
    traces = objective.recorded[:, columns]
    size = traces[~traces.isnan()].std()
    return OffsetErrors(
        pattern, torch.where(size > 0, size, objective.noise.std[fault.sensor])[None]
    )
