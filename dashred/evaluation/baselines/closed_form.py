"""Linear systems: the paper's closed form, mode by mode (Bao & Kutz 2025, linear assimilation).

Where ``u_t = L u`` is linear with constant coefficients and self-adjoint, its eigenfunctions φ_n
are known, and so are those of ``u_t = (L + L') u`` for an L' of the same kind. The sensors read

    y(t) = Σ a'_n e^{λ'_n (t − t₀)} φ_n(x_s),    λ'_n = λ_n + λ(L')_n

in which a' enters linearly; λ' follows by Gauss-Newton steps, each a linear problem. No network, no
simulation and no search has a part in it: what it says, any other method has to say too.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import combinations

import torch
from torch import Tensor

from dashred.evaluation.baselines.estimate import Estimated, TermEntry
from dashred.physics.expressions.algebra import Expr, add
from dashred.physics.expressions.linear import is_linear, split_linear
from dashred.physics.grids.fourier_symbols import symbols
from dashred.physics.grids.spectral import Spectral
from dashred.physics.runs.initial_state_prior import StartPrior
from dashred.physics.system import System, Term
from dashred.pipeline.problem import Problem

STEPS, TOLERANCE = 50, 1e-10
# A mode is an eigenfunction where what is left of L φ is rounding.
ROUNDING = 1e-9
MOST_TERMS = 3


@dataclass(frozen=True)
class Traces:
    """What is known of the modes before any fit.

    Attributes:
        readings: of every mode by every sensor, ``(mode, sensor)``.
        rates: λ, ``(mode,)``.
        known: amplitudes of the nominal start, ``(mode,)``; their prior is ``N(known, 1)``.
        times: since the start, ``(time,)``.
        values: recorded, ``(time, sensor)``; NaN is missing.
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
        covariance: of ξ, the amplitudes being unknown, ``(parameter, parameter)``.
        misfit: of traces, in σ, and of amplitudes and shifts to their prior, squared.
    """

    amplitudes: Tensor
    shifts: Tensor
    coefficients: Tensor
    covariance: Tensor
    misfit: float


def closed_form(problem: Problem, prior: StartPrior) -> Estimated | None:
    """Return field and law; None for a system that is not linear, or not self-adjoint.

    The rates are those of the few terms of L' that explain the traces best.

    Args:
        problem: the recording.
        prior: of the start, whose modes are the eigenfunctions.
    """
    operator = _operator(problem.system)
    rates = None if operator is None else eigenvalues(problem.system, operator, prior.basis)
    if rates is None or prior.shared:
        return None
    basis = prior.start(torch.eye(prior.size, dtype=torch.float64)) - prior.centre
    traces = _traces(problem, prior, basis, rates)
    terms, shapes = _linear_terms(problem, prior)
    members, fitted = _choose(traces, shapes)
    grown = torch.exp((rates + fitted.shifts) * traces.times[:, None])
    states = torch.einsum("tm,m...->t...", grown * fitted.amplitudes, basis)
    law = [
        TermEntry(equation=terms[j].equation, term=str(terms[j]), coefficient=value)
        for j, value in zip(members, fitted.coefficients.tolist(), strict=True)
    ]
    return Estimated(states, law, f"{len(rates)} modes")


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
    """Return λ_n of a linear operator, ``(mode,)``; None where a mode is no eigenfunction.

    Args:
        system: its grid.
        operator: linear, with constant coefficients.
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

    Shifts have a prior as wide as the simulator's own rates, so that a mode which is not there has
    none.

    Args:
        traces: the modes and the recording.
        shapes: M, what each parameter adds to the rates, ``(mode, parameter)``.
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
    away = phi - centre
    misfit = float(residuals @ residuals + away @ precision @ away)
    return Fitted(phi[:count], shapes @ phi[count:], phi[count:], covariance, misfit)


def _linearised(phi: Tensor, traces: Traces, shapes: Tensor) -> tuple[Tensor, Tensor]:
    """Return scaled residuals ``(reading,)`` and their derivatives ``(reading, unknown)``."""
    count = len(traces.rates)
    amplitudes, shifts = phi[:count], shapes @ phi[count:]
    grown = torch.exp((traces.rates + shifts) * traces.times[:, None])
    by_amplitude = torch.einsum("tm,ms->tsm", grown, traces.readings)
    by_shift = by_amplitude * amplitudes * traces.times[:, None, None]
    columns = torch.cat([by_amplitude, by_shift @ shapes], dim=2) / traces.noise[:, None]
    residuals = (by_amplitude @ amplitudes - traces.values) / traces.noise
    seen = ~traces.values.isnan()
    return residuals[seen], columns[seen]


def _operator(system: System) -> Expr | None:
    """Return L of a system of one field that is nothing else."""
    if len(system.fields) != 1 or not system.axes or not system.spectral:
        return None
    [field] = system.fields
    _, rest = split_linear(system.resolved[field], field)
    return system.resolved[field] if rest == add(()) else None


def _linear_terms(problem: Problem, prior: StartPrior) -> tuple[list[Term], Tensor]:
    """Return the library's linear, self-adjoint terms, and their eigenvalues ``(mode, term)``."""
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
    """Return the terms of least BIC, each charged ``ln n + 2 ln p`` of p terms, and their fit."""
    readings, count = int((~traces.values.isnan()).sum()), shapes.shape[1]
    charge = math.log(readings) + 2 * math.log(max(1, count))
    fits = (
        (list(members), fit_modes(traces, shapes[:, list(members)]))
        for size in range(MOST_TERMS + 1)
        for members in combinations(range(count), size)
    )
    return min(fits, key=lambda each: each[1].misfit + charge * len(each[0]))
