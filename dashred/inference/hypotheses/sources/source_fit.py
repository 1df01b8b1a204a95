"""Fit of a localised source through the simulator by Gauss–Newton steps.

The unknowns are the start, the law, the amplitudes of the source, its place and width, and the
unknowns of its course. The source is a forcing with one bump. The derivatives by its place and its
frequency are forcings as well, so that nothing is compiled.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import NamedTuple

import torch
from torch import Tensor

from dashred.inference.fit.least_squares import LeastSquaresProblem, NormalEquations
from dashred.inference.fit.noise_model import NoiseModel
from dashred.inference.forward.forcing_block import ForcingBlock
from dashred.inference.hypotheses.sources.courses import slopes
from dashred.inference.hypotheses.sources.screening import Source
from dashred.physics.forcing_basis import ForcingBasis, knots_over
from dashred.physics.system import System

ROUNDS, TOLERANCE = 12, 1e-3
# Shares of a step that are tried, and the largest step of ln w.
SHARES, LOG_WIDTH_STEP = (1.0, 0.5, 0.2, 0.05), 0.5
# Smallest width, in grid points: the simulator does not resolve a narrower bump.
NARROWEST = 0.8
# Knots of the course in a period or a sampling interval, and most knots.
KNOTS_PER_PERIOD, KNOTS_PER_SAMPLE, MOST_KNOTS = 32, 2, 600


@dataclass(frozen=True)
class SourceFit:
    """A source with its fit.

    Attributes:
        source: the source.
        objective: F of the start, the law, and the source, whose slopes are further amplitudes.
        phi: unknowns of the start and of the law, ``(unknown,)``.
        cost: F at the minimum.
        chi2: the part of F that is the misfit.
        readings: at the minimum, ``(time, sensor)``.
        normal: F linearised at the minimum or one small step before it, in the unknowns of the
            start and of the law, the amplitudes, the place, ln of the width and the unknowns of the
            course.
    """

    source: Source
    objective: LeastSquaresProblem
    phi: Tensor
    cost: float
    chi2: float
    readings: Tensor
    normal: NormalEquations

    @property
    def covariance(self) -> Tensor:
        """Covariance of the amplitudes and of the unknowns after them, ``(unknown, unknown)``."""
        own = len(self.phi)
        return self.normal.covariance(range(len(self.normal.phi)))[own:, own:]

    def noise(self) -> NoiseModel:
        """Estimate the noise from the residuals."""
        spent = self.normal.effective_parameters(range(len(self.normal.phi)))
        return self.objective.estimate_noise(self.readings, spent)


def fit_source(
    base: LeastSquaresProblem,
    phi: Tensor,
    source: Source,
    size: Tensor,
    tolerance: float = TOLERANCE,
    largest_width: float = math.inf,
) -> SourceFit:
    """Fit a source together with the start and a law.

    Args:
        base: F of the start and the law.
        phi: their unknowns at which the fit begins, ``(unknown,)``.
        source: the source at which the fit begins.
        size: rms of each equation's own tendency, ``(equation,)``.
        tolerance: the fit ends at a step that lowers F by a smaller share.
        largest_width: the fit also ends, before its minimum, when the bump is wider than this.
    """
    problem = _SourceProblem(base, size)
    point = problem.at(phi, source)
    for _ in range(ROUNDS):
        normal = problem.linearise(point.phi, point.source)
        if not normal.is_finite:
            break
        step = _step(normal, base, point.source, point.phi)
        before = point.cost
        for share in SHARES:
            moved = problem.moved(point.source, share * step[len(phi) :])
            trial = problem.at(point.phi + share * step[: len(phi)], moved)
            if trial.cost < point.cost:
                point = trial
                break
        is_wide = point.source.bump.width > largest_width
        if is_wide or before - point.cost < tolerance * point.cost:
            break
    objective = problem.objective(point.source)
    return SourceFit(
        point.source, objective, point.phi, point.cost, point.chi2, point.readings, normal
    )


class _Point(NamedTuple):
    """Unknowns of the start and the law, a source, and F, its misfit and the readings there."""

    phi: Tensor
    source: Source
    cost: float
    chi2: float
    readings: Tensor


def _step(
    normal: NormalEquations, base: LeastSquaresProblem, source: Source, phi: Tensor
) -> Tensor:
    """Return the Gauss–Newton step of the start, the law, the amplitudes and the shape."""
    solution = normal.solution(range(len(normal.phi)))
    step = solution.clone()
    last = len(phi) + len(source.amplitudes)
    step[:last] -= normal.phi[:last]
    return step


@dataclass(frozen=True)
class _SourceProblem:
    """F of a start, a law and a source, and its derivatives."""

    base: LeastSquaresProblem
    size: Tensor

    @property
    def system(self) -> System:
        return self.base.forward_model.simulator.system

    def objective(self, source: Source) -> LeastSquaresProblem:
        """Return F with the forcing of a source, whose slopes are further amplitudes."""
        model = self.base.forward_model
        block = ForcingBlock(self._basis(source), self.size)
        stds = torch.full((block.count,), 1.0, dtype=torch.float64)
        forced = replace(model, forcing=block)
        return self.base.with_unknowns(forced, stds)

    def at(self, phi: Tensor, source: Source) -> _Point:
        """Return F, the part of it that is the misfit, and the readings at a point."""
        objective = self.objective(source)
        whole = torch.cat([phi, self._amplitudes(source).flatten()])
        _, trials = objective.values(whole[None])
        chi2 = float(trials.residuals.square().sum())
        std = source.amplitude_std(self.system, self.size)
        prior = float(self.base.penalty(phi)) + float((source.amplitudes / std).square().sum())
        cost = chi2 + prior
        if not math.isfinite(cost):
            cost = chi2 = math.inf
        return _Point(phi, source, cost, chi2, trials.readings[0])

    def linearise(self, phi: Tensor, source: Source) -> NormalEquations:
        """Return F linearised in start, law, amplitudes, place, ln of the width, and course."""
        objective = self.objective(source)
        amplitudes = self._amplitudes(source)
        normal = objective.linearise(torch.cat([phi, amplitudes.flatten()]))
        count, places = len(source.amplitudes), torch.arange(amplitudes.numel())
        index = places.reshape(amplitudes.shape)[source.equation]
        columns = [*index[0, :count], *index[1:, count], *index[0, count + 1 :]]
        chosen = [*range(len(phi)), *(len(phi) + int(c) for c in columns)]
        stds = self._stds(source)
        return replace(
            normal,
            jacobian=normal.jacobian[:, chosen],
            precision=torch.cat([self.base.precision, stds**-2]),
            phi=normal.phi[chosen],
        )

    def moved(self, source: Source, move: Tensor) -> Source:
        """Return a source with its amplitudes and its shape moved, within the bounds of a step."""
        count, bump, course = len(source.amplitudes), source.bump, source.course
        amplitudes = source.amplitudes + move[:count]
        shape = move[count:].tolist()
        limits = self._limits(source)
        bounded = [min(max(m, -most), most) for m, most in zip(shape, limits, strict=True)]
        axes = len(bump.centre)
        moved = bump.moved(bounded[: axes + 1]).within(self.system)
        narrowest = NARROWEST * max(axis.spacing for axis in self.system.axes)
        values = tuple(
            value + m for value, m in zip(course.unknowns, bounded[axes + 1 :], strict=True)
        )
        return replace(
            source,
            amplitudes=amplitudes,
            bump=replace(moved, width=max(moved.width, narrowest)),
            course=course.with_unknowns(values),
        )

    def _limits(self, source: Source) -> list[float]:
        axes = len(source.bump.centre)
        return [source.bump.width] * axes + [LOG_WIDTH_STEP] + list(source.course.steps)

    def _stds(self, source: Source) -> Tensor:
        """Prior standard deviations: of the amplitudes, and of a step of the shape."""
        std = source.amplitude_std(self.system, self.size)
        shape = [10 * limit for limit in self._limits(source)]
        return torch.tensor([std] * len(source.amplitudes) + shape, dtype=torch.float64)

    def _basis(self, source: Source) -> ForcingBasis:
        """Return the bump and its slopes, times the functions of the course and its slopes."""
        times = self.base.forward_model.times
        duration = float(times.max() - times.min())
        count = KNOTS_PER_SAMPLE * len(times)
        if source.course.period:
            count = max(count, round(KNOTS_PER_PERIOD * duration / source.course.period))
        knots = knots_over(times, min(count, MOST_KNOTS))
        functions = source.course.functions(knots)
        along = functions @ source.amplitudes
        further = slopes(source.course, source.amplitudes, knots)
        courses = torch.stack([*functions.T, along, *further], dim=1)
        bumps = [source.bump.on_grid(self.system), *source.bump.slopes(self.system)]
        return ForcingBasis(torch.stack(bumps), knots, courses, len(self.system.fields))

    def _amplitudes(self, source: Source) -> Tensor:
        """Return the amplitudes of the forcing, ``(equation, bump, course)``."""
        count, axes = len(source.amplitudes), len(source.bump.centre)
        courses = count + 1 + len(source.course.unknowns)
        shape = len(self.system.fields), axes + 2, courses
        found = torch.zeros(shape, dtype=torch.float64)
        found[source.equation, 0, :count] = source.amplitudes
        return found
