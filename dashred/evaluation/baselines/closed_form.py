"""Linear systems: the paper's closed form, mode by mode (Bao & Kutz 2025, linear assimilation).

Where ``u_t = L u`` is linear with constant coefficients and self-adjoint, its eigenfunctions φ_n
are known, and so are those of ``u_t = (L + L') u`` for an L' of the same kind. The sensors read

    y(t) = Σ a'_n e^{λ'_n (t − t₀)} φ_n(x_s),    λ'_n = λ_n + λ(L')_n

in which a' enters linearly; λ' follows by Gauss-Newton steps, each a linear problem. It needs no
network and no simulation, so that its result is a reference for the other methods.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import combinations

import torch
from torch import Tensor

from dashred.evaluation.baselines.estimate import Estimate, TermEntry
from dashred.physics.expressions.algebra import Expr, add
from dashred.physics.expressions.linear import is_linear, split_linear
from dashred.physics.grids.fourier_symbols import symbols
from dashred.physics.grids.spectral import Spectral
from dashred.physics.runs.initial_state_prior import StartPrior
from dashred.physics.system import System, Term
from dashred.pipeline.problem import Problem

STEPS, TOLERANCE = 50, 1e-10
# Largest relative residual of L φ for an eigenfunction: rounding errors.
ROUNDING = 1e-9
MAX_TERMS = 3


@dataclass(frozen=True)
class Traces:
    """The modes and the recording before any fit.

    Attributes:
        readings: readings of every mode, ``(mode, sensor)``.
        rates: λ, ``(mode,)``.
        known: amplitudes of the nominal start, ``(mode,)``; their prior is ``N(known, 1)``.
        times: times since the start, ``(time,)``.
        values: recorded values, ``(time, sensor)``; NaN where missing.
        noise: σ of each sensor, ``(sensor,)``.
    """

    readings: Tensor
    rates: Tensor
    known: Tensor
    times: Tensor
    values: Tensor
    noise: Tensor


@dataclass(frozen=True)
class Fitted:
    """Amplitudes, and rates ``λ' = λ + M ξ``.

    Attributes:
        amplitudes: a', ``(mode,)``.
        shifts: λ' − λ, ``(mode,)``.
        coefficients: ξ, ``(parameter,)``.
        covariance: covariance of ξ, marginalised over the amplitudes, ``(parameter, parameter)``.
        misfit: squared misfit of traces, in σ, and of amplitudes and shifts to their priors.
    """

    amplitudes: Tensor
    shifts: Tensor
    coefficients: Tensor
    covariance: Tensor
    misfit: float


def closed_form(problem: Problem, prior: StartPrior) -> Estimate | None:
    """Return field and law; None for a system that is not linear or not self-adjoint.

    L' has the few terms that explain the traces best.

    Args:
        problem: the recording.
        prior: prior of the start; its modes are the eigenfunctions.
    """
    operator = _operator(problem.system)
    rates = None if operator is None else eigenvalues(problem.system, operator, prior.basis)
    if rates is None or prior.shared:
        return None
    basis = prior.start(torch.eye(prior.size, dtype=torch.float64)) - prior.centre
    traces = _traces(problem, prior, basis, rates)
    terms, shapes = _linear_terms(problem, prior)
    members, fitted = _choose(traces, shapes)
    growth = torch.exp((rates + fitted.shifts) * traces.times[:, None])
    states = torch.einsum("tm,m...->t...", growth * fitted.amplitudes, basis)
    law = [
        TermEntry(equation=terms[j].equation, term=str(terms[j]), coefficient=value)
        for j, value in zip(members, fitted.coefficients.tolist(), strict=True)
    ]
    return Estimate(states, law, f"{len(rates)} modes")


def _traces(problem: Problem, prior: StartPrior, basis: Tensor, rates: Tensor) -> Traces:
    fit = problem.split.fit
    centre = prior.centre.flatten()[:, None]
    return Traces(
        readings=problem.operator(fit)(basis),
        rates=rates,
        known=torch.linalg.lstsq(basis.flatten(1).T, centre).solution[:, 0],
        times=problem.times[: len(fit.times)] - problem.times[0],
        values=torch.from_numpy(fit.values),
        noise=problem.noise_of(fit.names),
    )


def eigenvalues(system: System, operator: Expr, basis: Tensor) -> Tensor | None:
    """Return λ_n of a linear operator, ``(mode,)``; None if a mode is not an eigenfunction.

    Args:
        system: the system with the grid.
        operator: linear operator with constant coefficients.
        basis: the modes, ``(mode, *grid)``.
    """
    assert isinstance(system.operators, Spectral)
    symbol = symbols([[operator]], system.operators, basis.device)[0]
    dims = system.grid.dims
    image = torch.fft.irfftn(symbol * torch.fft.rfftn(basis, dim=dims), s=basis.shape[1:], dim=dims)
    flat, images = basis.flatten(1), image.flatten(1)
    rates = (flat * images).sum(dim=1) / flat.square().sum(dim=1)
    left = (images - rates[:, None] * flat).abs().amax()
    return rates if float(left) <= ROUNDING * float(images.abs().amax()) else None


def fit_modes(traces: Traces, shapes: Tensor) -> Fitted:
    """Fit amplitudes and rates to sensor traces.

    The prior of the shifts is as wide as the simulator's rates: an unobserved mode has shift 0.

    Args:
        traces: the modes and the recording.
        shapes: M, the change of the rates per parameter, ``(mode, parameter)``.
    """
    width = float(traces.rates.square().mean().sqrt()) or 1.0
    count = len(traces.rates)
    precision = torch.eye(count + shapes.shape[1], dtype=torch.float64)
    precision[count:, count:] = shapes.T @ shapes / width**2
    centre = torch.cat([traces.known, shapes.new_zeros(shapes.shape[1])])
    phi = centre.clone()
    for _ in range(STEPS):
        residuals, jacobian = _linearised(phi, traces, shapes)
        normal = jacobian.T @ jacobian + precision
        gradient = jacobian.T @ residuals + precision @ (phi - centre)
        step = torch.linalg.solve(normal, -gradient)
        phi = phi + step
        if float(step @ normal @ step) <= TOLERANCE:
            break
    residuals, jacobian = _linearised(phi, traces, shapes)
    covariance = torch.linalg.inv(jacobian.T @ jacobian + precision)[count:, count:]
    deviation = phi - centre
    misfit = float(residuals @ residuals + deviation @ precision @ deviation)
    return Fitted(phi[:count], shapes @ phi[count:], phi[count:], covariance, misfit)


def _linearised(phi: Tensor, traces: Traces, shapes: Tensor) -> tuple[Tensor, Tensor]:
    """Return scaled residuals ``(reading,)`` and their derivatives ``(reading, unknown)``."""
    count = len(traces.rates)
    amplitudes, shifts = phi[:count], shapes @ phi[count:]
    growth = torch.exp((traces.rates + shifts) * traces.times[:, None])
    by_amplitude = torch.einsum("tm,ms->tsm", growth, traces.readings)
    by_shift = by_amplitude * amplitudes * traces.times[:, None, None]
    columns = torch.cat([by_amplitude, by_shift @ shapes], dim=2) / traces.noise[:, None]
    residuals = (by_amplitude @ amplitudes - traces.values) / traces.noise
    seen = ~traces.values.isnan()
    return residuals[seen], columns[seen]


def _operator(system: System) -> Expr | None:
    """Return L of a linear system of one field; None for other systems."""
    if len(system.fields) != 1 or not system.axes or not system.spectral:
        return None
    [field] = system.fields
    _, rest = split_linear(system.resolved[field], field)
    return system.resolved[field] if rest == add(()) else None


def _linear_terms(problem: Problem, prior: StartPrior) -> tuple[list[Term], Tensor]:
    """Return the linear, self-adjoint library terms and their eigenvalues, ``(mode, term)``."""
    system, [field] = problem.system, problem.system.fields
    terms, columns = [], []
    for term in problem.library:
        resolved = system.resolve(term.expression, f"library.{field}")
        linear = is_linear(resolved, field)
        values = eigenvalues(system, resolved, prior.basis) if linear else None
        if values is not None:
            terms.append(term)
            columns.append(values)
    return terms, torch.stack(columns, dim=1)


def _choose(traces: Traces, shapes: Tensor) -> tuple[list[int], Fitted]:
    """Return the terms of least BIC, with penalty ``ln n + 2 ln p`` per term, and their fit."""
    readings, count = int((~traces.values.isnan()).sum()), shapes.shape[1]
    penalty = math.log(readings) + 2 * math.log(max(1, count))
    fits = (
        (list(members), fit_modes(traces, shapes[:, list(members)]))
        for size in range(MAX_TERMS + 1)
        for members in combinations(range(count), size)
    )
    return min(fits, key=lambda each: each[1].misfit + penalty * len(each[0]))
