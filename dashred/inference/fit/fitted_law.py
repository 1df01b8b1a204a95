"""The law of a fit, with its error bars (docs/method.md#error-bars)."""

from __future__ import annotations

import torch
from torch import Tensor

from dashred.inference.fit.law import FittedParameter, Law
from dashred.inference.fit.least_squares import LeastSquaresProblem, NormalEquations
from dashred.inference.fit.levenberg_marquardt import FitResult
from dashred.inference.forward.candidates import Candidate
from dashred.inference.forward.forward_model import ForwardModel


def build_selected_law(
    objective: LeastSquaresProblem,
    normal: NormalEquations,
    phi: Tensor,
    members: tuple[int, ...],
    readings: Tensor,
    score: float,
) -> Law:
    """Return the law of one set of candidates at a minimum of F.

    ``cov = (JᵀWᵀWJ + P)⁻¹`` over the start and the coefficients of the law
    (docs/method.md#error-bars).

    Args:
        objective: F of all candidates.
        normal: normal equations of all candidates at the minimum, or near it.
        phi: the minimum, ``(unknown,)``.
        members: indices of the candidates of the law.
        readings: readings at the minimum, ``(time, sensor)``.
        score: score of the law.
    """
    forward_model = objective.forward_model
    z, xi = objective.split(phi)
    covariance = normal.covariance(objective.indices(members))
    chi2 = float(objective.residuals(readings).square().sum()) / objective.noise.count
    return Law(
        candidates=tuple(forward_model.law.candidates[j] for j in members),
        coefficients=xi[list(members)],
        covariance=covariance[objective.modes :, objective.modes :],
        start=forward_model.starts(z[None])[0],
        score=score,
        chi2=chi2,
        residuals=readings - objective.recorded,
        parameters=_fitted_parameters(forward_model, z, covariance),
    )


def build_law(
    objective: LeastSquaresProblem,
    fitted: FitResult,
    score: float,
    known: NormalEquations | None = None,
) -> Law:
    """Return the law of all candidates of F at a minimum of F.

    Args:
        objective: F.
        fitted: the minimum.
        score: score of the law.
        known: normal equations at the minimum, if they are known already.
    """
    candidates, modes = fitted_candidates(objective, fitted.phi), objective.modes
    count, last = len(candidates), objective.forward_model.law.count
    z, xi = objective.split(fitted.phi)
    normal = known or objective.linearise(fitted.phi, fitted.readings)
    covariance = normal.covariance(range(len(fitted.phi)))
    stds = covariance.diagonal().clamp(min=0).sqrt().tolist()
    return Law(
        candidates=candidates,
        coefficients=xi[:count],
        covariance=covariance[modes : modes + count, modes : modes + count],
        start=objective.forward_model.starts(z[None])[0],
        score=score,
        chi2=fitted.chi2 / objective.noise.count,
        residuals=torch.where(
            objective.noise.available, fitted.readings - objective.recorded, torch.nan
        ),
        edges=tuple(stds[modes + count : modes + last]),
        parameters=_fitted_parameters(objective.forward_model, z, covariance),
    )


def _fitted_parameters(
    forward_model: ForwardModel, z: Tensor, covariance: Tensor
) -> tuple[FittedParameter, ...]:
    """Return the uncertain parameters of a fit.

    Args:
        forward_model: with the parameters.
        z: unknowns of the start and the parameters, ``(mode,)``.
        covariance: posterior covariance, of z first.
    """
    known, size = forward_model.simulator.parameters, forward_model.start.size
    stds = covariance.diagonal()[size : len(z)].clamp(min=0).sqrt() * known.stds
    changes = forward_model.parameter_changes(z)
    rows = zip(known.candidates, changes.tolist(), stds.tolist(), strict=True)
    return tuple(FittedParameter(*row) for row in rows)


def fitted_candidates(objective: LeastSquaresProblem, phi: Tensor) -> tuple[Candidate, ...]:
    """Return the candidates of a fit; local terms carry the fitted window."""
    forward_model = objective.forward_model
    return forward_model.law.terms(objective.split(phi)[1][forward_model.slices.law])
