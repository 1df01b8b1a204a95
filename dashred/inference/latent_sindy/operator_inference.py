"""Operator inference: simulator steps fitted to snapshots, for simulators that cannot be run."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product

import torch
from jaxtyping import Float
from torch import Tensor

from dashred.inference.latent_sindy.step_sensitivities import Step
from dashred.models.pod import POD
from dashred.physics.runs.stored_states import States, each_state
from dashred.physics.system import System, Term
from dashred.physics.terms.library import evaluate_terms

# The settings tried: numbers of POD modes whose products are features, and ridge penalties as
# shares of the mean square of the features.
SIZES, RIDGES = (3, 6, 10, 16), (1e-10, 1e-8, 1e-6, 1e-4, 1e-2)


@dataclass(frozen=True)
class QuadraticStep:
    """A step ``a_{t+n} = a_t + W φ(a_t)`` of POD coefficients a.

    The features φ are 1, a, and the products of the leading coefficients. This is the discrete form
    of operator inference (Peherstorfer & Willcox 2016). It is exact for linear and quadratic
    equations, up to the truncation of the modes, and an approximation for others.

    Attributes:
        size: number of leading coefficients whose products are features.
        weights: ``(feature, mode)``, for coefficients in units of ``spread``.
        spread: std of each coefficient, ``(mode,)``.
    """

    size: int
    weights: Tensor
    spread: Tensor

    def __call__(self, coefficients: Float[Tensor, "*batch mode"]) -> Float[Tensor, "*batch mode"]:
        """Return the coefficients after the step."""
        scaled = coefficients / self.spread
        return coefficients + (_features(scaled, self.size) @ self.weights) * self.spread


@dataclass(frozen=True)
class SnapshotSteps:
    """Steps of a simulator that is known only from snapshots.

    Attributes:
        system: its fields and grid.
        library: the candidates.
        pod: basis of the snapshots.
        by_stride: the fitted step for each step length, in samples.
        errors: RMSE of the increment of each step on held-out runs, as a share of the rms of the
            increment.
    """

    system: System
    library: Sequence[Term]
    pod: POD
    by_stride: dict[int, QuadraticStep]
    errors: dict[int, float]

    @classmethod
    def fit(
        cls,
        system: System,
        library: Sequence[Term],
        pod: POD,
        states: States,
        held_out: int,
        strides: Sequence[int],
    ) -> SnapshotSteps:
        """Fit steps of several lengths; held-out members select the settings.

        Args:
            system: fields and grid.
            library: the candidates.
            pod: basis of the training members.
            states: runs at uniform times, ``(member, time, field, *grid)``.
            held_out: number of last members that are not used in the fit; half of them select the
                settings, and the others measure the error.
            strides: lengths of the steps, in samples.
        """
        coefficients = each_state(pod.encode, states)
        spread = coefficients[:-held_out].flatten(0, 1).std(dim=0).clamp(min=1e-300)
        fitted, errors = {}, {}
        for stride in strides:
            before, after = coefficients[:, :-stride], coefficients[:, stride:]
            train, choose, measure = (
                (before[rows].flatten(0, 1), after[rows].flatten(0, 1))
                for rows in (
                    slice(None, -held_out),
                    slice(-held_out, -(held_out // 2)),
                    slice(-(held_out // 2), None),
                )
            )
            candidates = [
                _fit(*train, spread, size, ridge)
                for size, ridge in product(SIZES, RIDGES)
                if size <= len(spread) or size == SIZES[0]
            ]
            best = min(candidates, key=lambda step: _error(step, *choose))
            fitted[stride], errors[stride] = best, _error(best, *measure)
        return cls(system, library, pod, fitted, errors)

    def forecasts(
        self, fields: Tensor, times: Tensor, begins: Tensor, strides: Sequence[int]
    ) -> list[Step]:
        """Return forecasts from the reconstructed fields; see :meth:`Steps.forecasts`."""
        start = fields[begins]
        steps = []
        for stride in strides:
            path = torch.stack([start, self.advance(start, stride)], dim=1)
            steps.append(Step(begins, begins + stride, float(times[begins[0]]), path))
        return steps

    def advance(self, states: Float[Tensor, "*dims"], stride: int) -> Float[Tensor, "*dims"]:
        """Return states ``(*batch, field, *grid)`` after one step.

        The increment is added to the field, so that the part outside the POD basis stays.
        """
        coefficients = self.pod.encode(states)
        after = self.by_stride[stride](coefficients)
        return states + self.pod.decode(after) - self.pod.decode(coefficients)

    def columns(self, fields: Tensor, times: Tensor, steps: Sequence[Step]) -> list[Tensor]:
        """Return the columns of the paper, ``θ_j(û) Δt``: no simulator can propagate a term."""
        found = []
        for step in steps:
            theta = evaluate_terms(self.system, self.library, fields[step.begins], step.time)
            column = fields.new_zeros((len(step.begins), len(self.library), *fields.shape[1:]))
            durations = times[step.ends] - times[step.begins]
            shape = (-1,) + (1,) * (fields.dim() - 2)
            for j, term in enumerate(self.library):
                index = self.system.fields.index(term.equation)
                column[:, j, index] = theta[j] * durations.reshape(shape)
            found.append(column)
        return found


def _features(scaled: Float[Tensor, "*batch mode"], size: int) -> Float[Tensor, "*batch feature"]:
    leading = scaled[..., :size]
    rows, columns = torch.triu_indices(leading.shape[-1], leading.shape[-1])
    products = leading[..., rows] * leading[..., columns]
    return torch.cat([torch.ones_like(scaled[..., :1]), scaled, products], dim=-1)


def _fit(before: Tensor, after: Tensor, spread: Tensor, size: int, ridge: float) -> QuadraticStep:
    features = _features(before / spread, size)
    gram = features.T @ features
    penalty = ridge * gram.diagonal().mean() * torch.eye(len(gram), dtype=gram.dtype)
    right = features.T @ ((after - before) / spread)
    return QuadraticStep(size, torch.linalg.solve(gram + penalty, right), spread)


def _error(step: QuadraticStep, before: Tensor, after: Tensor) -> float:
    """Return the RMSE of the increment in POD coefficients, as a share of its rms."""
    error = (step(before) - after).square().mean()
    return float((error / (after - before).square().mean().clamp(min=1e-300)).sqrt())
