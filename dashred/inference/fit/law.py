"""A law: some candidates with their coefficients, fitted together with the start."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import torch
from torch import Tensor

from dashred.inference.fit.least_squares import LeastSquaresProblem, NormalEquations
from dashred.inference.fit.levenberg_marquardt import FitResult
from dashred.inference.forward.candidates import Candidate, build_forcing
from dashred.physics.solvers.forcing import Forcing
from dashred.physics.window import Window

# Two-sided 95 % of a normal distribution.
Z95 = 1.959964


@dataclass(frozen=True)
class SensorFault:
    """What is wrong with a sensor.

    Attributes:
        kind: bias, drift, stuck, spikes or misplaced.
        sensor: its name.
        value: the bias, the drift per unit time, the value at which it is stuck, how many spikes,
            or how far off its stated place it is.
        std: its posterior standard deviation; None for a count.
        begin: time from which on it is stuck; None for the other kinds.
        episode: the one in which it is at fault, counted from 0; None if in all that there are.
    """

    kind: str
    sensor: str
    value: float
    std: float | None
    begin: float | None
    episode: int | None = None


@dataclass(frozen=True)
class Law:
    """One explanation of the recording.

    Attributes:
        candidates: what is missing or mis-stated; empty for the simulator as it is.
        coefficients: ξ, ``(candidate,)``, in the user's units.
        covariance: posterior covariance of ξ, the start's uncertainty in it.
        start: states at the first sample, ``(episode, field, *grid)``.
        score: ``F + k (ln n + 2 ln p)``; differences are ΔBIC.
        chi2: mean squared whitened residual over the fit; 1 for noise alone.
        residuals: readings minus recording over the fit, ``(time, sensor)``, NaN where missing.
        edges: posterior std of the window's unknowns; empty without a window.
        threshold: 95 % interval of a gate's threshold; None without one, or where only its std is
            known.
        fault: what is wrong with a sensor, beside the law; None if nothing is.
        start_prior_factor: by how much the start lies outside of its prior, as a factor of its spread.
    """

    candidates: tuple[Candidate, ...]
    coefficients: Tensor
    covariance: Tensor
    start: Tensor
    score: float
    chi2: float
    residuals: Tensor
    edges: tuple[float, ...] = ()
    threshold: tuple[float, float] | None = None
    fault: SensorFault | None = None
    start_prior_factor: float = 1.0

    @property
    def std(self) -> Tensor:
        """Posterior standard deviations, ``(candidate,)``."""
        return self.covariance.diagonal().clamp(min=0).sqrt()

    @property
    def keys(self) -> frozenset[str]:
        """Its candidates, whatever acts beside them or limits them."""
        return frozenset(candidate.key for candidate in self.candidates)

    @property
    def parts(self) -> frozenset[str]:
        """Everything that it says is otherwise than believed; nothing for the empty law.

        A term in a window is that term with a freedom more: everywhere, it is nested in it. So is a
        parameter that stands for the term.
        """
        found = {
            candidate.replaces[0] if candidate.replaces else candidate.key
            for candidate in self.candidates
        }
        if self.window is not None:
            found.add(f"in a {self.window.shape.kind} of {self.window.shape.of}")
        return frozenset([*found, *self._other_causes])

    @property
    def _other_causes(self) -> list[str]:
        """What it says beside its terms."""
        found = []
        if self.fault is not None:
            found.append(f"{self.fault.kind} of {self.fault.sensor}")
        if self.start_prior_factor > 1:
            found.append("start outside of its prior")
        return found

    @property
    def is_extended(self) -> bool:
        """Whether it has terms that the library does not have."""
        return any(candidate.is_extended for candidate in self.candidates)

    @property
    def window(self) -> Window | None:
        """The window in which some of it acts."""
        return next((c.window for c in self.candidates if c.window is not None), None)

    def interval(self, index: int) -> tuple[float, float]:
        """Return the 95 % interval of one coefficient."""
        value, std = float(self.coefficients[index]), float(self.std[index])
        return value - Z95 * std, value + Z95 * std

    def forcing(self) -> Forcing | None:
        """Return the model error as the simulator takes it; None for the empty law."""
        if not self.candidates:
            return None
        return build_forcing(self.candidates, self.coefficients[None])

    def __str__(self) -> str:
        """``u: 0.0249*u - 0.0251*u**3``; ``nothing`` for the empty law."""
        parts = [
            f"{candidate} × {value:.4g}"
            for candidate, value in zip(self.candidates, self.coefficients.tolist(), strict=True)
        ]
        return ", ".join([*parts, *self._other_causes]) or "nothing"


def build_selected_law(
    objective: LeastSquaresProblem,
    normal: NormalEquations,
    phi: Tensor,
    members: tuple[int, ...],
    readings: Tensor,
    score: float,
) -> Law:
    """Return the law at a minimum of F, its covariance from the Hessian.

    ``cov = (JᵀWᵀWJ + P)⁻¹`` over the start and the law's own coefficients
    (docs/method.md#error-bars).

    Args:
        objective: F.
        normal: normal equations about the minimum, or near it, of all candidates.
        phi: the minimum, ``(unknown,)``.
        members: candidates of the law.
        readings: there, ``(time, sensor)``.
        score: of the law.
    """
    forward_model = objective.forward_model
    z, xi = objective.split(phi)
    covariance = normal.covariance(objective.indices(members))
    chi2 = float(objective.residuals(readings).square().sum()) / objective.noise.count
    return Law(
        candidates=tuple(forward_model.law.candidates[j] for j in members),
        coefficients=xi[list(members)],
        covariance=covariance[objective.modes :, objective.modes :],
        start=forward_model.start.start(z[None])[0],
        score=score,
        chi2=chi2,
        residuals=readings - objective.recorded,
    )


def build_law(
    objective: LeastSquaresProblem,
    fitted: FitResult,
    score: float,
    known: NormalEquations | None = None,
) -> Law:
    """Return the law at a minimum of F, with the covariance of its coefficients.

    Args:
        objective: F.
        fitted: its minimum.
        score: of the law.
        known: F linearised there, where it is known already.
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
        start=objective.forward_model.start.start(z[None])[0],
        score=score,
        chi2=fitted.chi2 / objective.noise.count,
        residuals=torch.where(
            objective.noise.available, fitted.readings - objective.recorded, torch.nan
        ),
        edges=tuple(stds[modes + count : modes + last]),
    )


def fitted_candidates(objective: LeastSquaresProblem, phi: Tensor) -> tuple[Candidate, ...]:
    """Return what a fit's coefficients multiply, terms in a window with its edges."""
    forward_model = objective.forward_model
    return forward_model.law.terms(objective.split(phi)[1][forward_model.slices.law])


def distinct_laws(laws: Sequence[Law]) -> list[Law]:
    """Return the laws, the best first, of several with the same candidates in like windows one."""
    kept: dict[object, Law] = {}
    for law in sorted(laws, key=lambda law: law.score):
        kept.setdefault(_form(law), law)
    return list(kept.values())


def _form(law: Law) -> object:
    parts = tuple(sorted(_form_of(candidate) for candidate in law.candidates))
    fault = (law.fault.kind, law.fault.sensor) if law.fault else None
    return parts, fault, law.start_prior_factor


def _form_of(candidate: Candidate) -> tuple[str, str, str]:
    window = candidate.window
    return candidate.key, *((window.shape.kind, window.shape.of) if window else ("", ""))
