"""Runs of a simulator of fields that are corrected towards the readings at every sample.

A simulator may lack what keeps it bounded. Its own run then leaves the range of the recording, or
blows up, and gives no scale of anything. Neither does a run that stands still. A corrected run
stays near the recording. With forecast x_f and readings y, optimal interpolation gives::

    x = x_f + M z        z = (HM)ᵀ (HM (HM)ᵀ + R)⁻¹ (y - H x_f)

M holds the modes of the start's prior, scaled so that the readings have their recorded spread
(Daley, *Atmospheric Data Analysis*, 1991, ch. 4).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
import torch
from torch import Tensor

from dashred.physics.runs.ensemble import Ensemble
from dashred.physics.runs.initial_state_prior import StartPrior
from dashred.physics.solvers.simulate import Progress, simulate
from dashred.pipeline.problem import Problem
from dashred.pipeline.simulation.reading_range import distance_from_readings

# A run has left the range of the recording if a reading of a quantity is farther from its mean over
# all sensors than this many of its standard deviations.
LOST = 10.0
# A field stands still if it changes by less than this, in standard deviations of its readings.
STILL = 1e-6
# Standard deviation of the factor by which the readings of each member of an ensemble are larger.
READING_SPREAD = 0.3
# A field stays within the range of its readings, widened by this share of it on both sides.
MARGIN = 0.5
# Shapes are independent if their singular value is above this share of the largest.
LEAST = 1e-6
Smoothing = Callable[[Tensor], Tensor]


def is_lost(problem: Problem, path: Tensor) -> bool:
    """Return whether a run leaves the range of the fitted readings or blows up.

    Args:
        problem: one episode.
        path: its simulation, ``(time, field, *grid)``.
    """
    fitted = path[: len(problem.split.fit.times)]
    return bool((distance_from_readings(problem, fitted) >= LOST).any())


def stands_still(problem: Problem, path: Tensor) -> bool:
    """Return whether a field that is read has one value everywhere, as from a uniform start.

    Args:
        problem: one episode.
        path: its simulation, ``(time, field, *grid)``.
    """
    fit = problem.split.fit
    for index, field in enumerate(problem.system.fields):
        own = path[:, index]
        mine = [j for j, sensor in enumerate(fit.sensors) if sensor.reads == field]
        if mine and float(own.max() - own.min()) <= STILL * float(np.nanstd(fit.values[:, mine])):
            return True
    return False


def nudged_ensemble(
    problem: Problem, prior: StartPrior, members: int, times: Tensor, rng: np.random.Generator
) -> Ensemble:
    """Return corrected runs from random starts, towards readings of different size.

    Args:
        problem: one episode.
        prior: distribution of its start.
        members: number of runs.
        times: of the fitted part, ``(time,)``.
        rng: random number generator.
    """
    factors = 1 + READING_SPREAD * torch.from_numpy(rng.standard_normal(members))
    runs = _nudged(problem, prior, prior.draw(members, rng), factors)
    # An episode that is shorter than the longest is repeated.
    states = runs[:, torch.arange(len(times)) % runs.shape[1]]
    return Ensemble(times, states, torch.zeros((members, len(problem.library))))


def _unchanged(states: Tensor) -> Tensor:
    return states


def _smoothing(prior: StartPrior) -> Smoothing:
    """Return the projection of states ``(batch, field, *grid)`` onto smooth ones."""
    bases = []
    for nominal in prior.centre:
        shapes = torch.cat([prior.basis.flatten(1), nominal.flatten()[None]])
        vectors, sizes, _ = torch.linalg.svd(shapes.T, full_matrices=False)
        bases.append(vectors[:, sizes > LEAST * sizes[0]])

    def smooth(states: Tensor) -> Tensor:
        fields = states.flatten(2).unbind(dim=1)
        found = [each @ basis @ basis.T for each, basis in zip(fields, bases, strict=True)]
        return torch.stack(found, dim=1).reshape(states.shape)

    return smooth


def _nudged(
    problem: Problem,
    prior: StartPrior,
    start: Tensor,
    factors: Tensor,
    smoothing: Smoothing = _unchanged,
    progress: Progress = lambda done: None,
) -> Tensor:
    """Return corrected runs, ``(member, time, field, *grid)``.

    Args:
        problem: the episode.
        prior: distribution of its start.
        start: of every run, ``(member, field, *grid)``.
        factors: by which the readings of each are multiplied about their mean, ``(member,)``.
        smoothing: is applied to the states after each correction.
        progress: called with the fraction done.
    """
    fit, times = problem.split.fit, problem.times
    operator, readings = problem.operator(fit), torch.from_numpy(fit.values)
    mean, grid = readings.nanmean(dim=0), problem.system.grid
    modes, seen = _modes(problem, prior)
    noise, (low, high) = problem.fit_noise_std(), _bounds(problem)
    farthest = LOST * torch.from_numpy(fit.trace_std()).clamp(min=1e-12)
    states, saved = start, []
    for k, own in enumerate(readings):
        if k:
            ahead = simulate(problem.system, states, times[k - 1 : k + 1])[:, -1]
            # A finite forecast may be too large for any correction.
            away = (operator(ahead, float(times[k])) - mean).abs()
            bounded = torch.isfinite(ahead).flatten(1).all(dim=1) & ~(away > farthest).any(dim=1)
            shape = (-1,) + (1,) * (states.dim() - 1)
            states = torch.where(bounded.reshape(shape), ahead, states)
        known = ~own.isnan()
        target = mean + factors[:, None] * (own - mean)
        apart = (target - operator(states, float(times[k])))[:, known]
        gain = _gain(seen[known], noise[known])
        states = states + torch.einsum("bs,ms,m...->b...", apart, gain, modes)
        # Between the sensors a field may leave the range of the readings. A mirror image has one
        # of its own, which follows.
        states = grid.ring(grid.own(smoothing(states)).clamp(low, high))
        saved.append(states)
        progress((k + 1) / len(readings))
    return torch.stack(saved, dim=1)


def _modes(problem: Problem, prior: StartPrior) -> tuple[Tensor, Tensor]:
    """Return M, ``(mode, field, *grid)``, and HM, ``(sensor, mode)``, scaled to the traces."""
    fit = problem.split.fit
    operator = problem.operator(fit)
    moves = prior.start(torch.eye(prior.size, dtype=torch.float64)) - prior.centre
    seen = (operator(prior.centre + moves) - operator(prior.centre)).T
    spread = seen.square().sum(dim=1).mean().sqrt().clamp(min=1e-300)
    scale = float(torch.from_numpy(fit.trace_std()).square().mean().sqrt() / spread)
    return scale * moves, scale * seen


def _bounds(problem: Problem) -> tuple[Tensor, Tensor]:
    """Return the range of the readings of each field, widened on both sides, ``(field, 1, …)``."""
    fit, system = problem.split.fit, problem.system
    low, high = (torch.full((len(system.fields),), bound) for bound in (-torch.inf, torch.inf))
    # Fields vanish at fixed ends.
    ends = [0.0] if any(axis.ends == "fixed" for axis in system.axes) else []
    for index, field in enumerate(system.fields):
        values = fit.values[:, [sensor.reads == field for sensor in fit.sensors]]
        values = values[np.isfinite(values)]
        if values.size:
            least, most = min([values.min(), *ends]), max([values.max(), *ends])
            margin = MARGIN * (most - least)
            low[index], high[index] = least - margin, most + margin
    shape = (-1,) + (1,) * len(system.grid.shape)
    return low.double().reshape(shape), high.double().reshape(shape)


def _gain(seen: Tensor, noise: Tensor) -> Tensor:
    """Return ``(HM)ᵀ (HM (HM)ᵀ + R)⁻¹``, ``(mode, sensor)``."""
    covariance = seen @ seen.T + torch.diag(noise.square())
    return torch.linalg.solve(covariance, seen).T


def nudged_where_lost(
    problem: Problem, prior: StartPrior, paths: Sequence[Tensor], progress: Progress
) -> tuple[Tensor, ...]:
    """Return the corrected runs of all fitted episodes if a run gives no scales.

    It gives none if it leaves the range of its recording, or stands still.

    Args:
        problem: the recording.
        prior: distribution of the start.
        paths: simulation of each episode, ``(time, field, *grid)``.
        progress: called with the fraction of each episode that is done.

    Returns:
        States at the times of each episode, ``(time, field, *grid)``. Beyond the fitted part, whose
        readings alone are used, they are repeated. Empty if every run gives scales.
    """
    pairs = zip(problem.episodes, paths, strict=True)
    if not any(is_lost(*each) or stands_still(*each) for each in pairs):
        return ()
    return tuple(_corrected(e, prior, progress) for e in problem.episodes)


def smooth_runs(problem: Problem, prior: StartPrior, progress: Progress) -> tuple[Tensor, ...]:
    """Return the corrected runs of smooth states of all fitted episodes.

    At every sample, each field is projected onto the modes of a random start and the nominal start.
    A simulator without its dissipation creates ever finer structures, which no sensor sees.

    Args:
        problem: the recording.
        prior: distribution of the start.
        progress: called with the fraction of each episode that is done.

    Returns:
        See :func:`nudged_where_lost`.
    """
    smoothing = _smoothing(prior)
    return tuple(_corrected(e, prior, progress, smoothing) for e in problem.episodes)


def _corrected(
    episode: Problem, prior: StartPrior, progress: Progress, smoothing: Smoothing = _unchanged
) -> Tensor:
    """Return the corrected run of one episode at all its times, ``(time, field, *grid)``."""
    factors = torch.ones(1, dtype=torch.float64)
    [states] = _nudged(episode, prior, prior.centre[None], factors, smoothing, progress)
    return states[torch.arange(len(episode.times)) % len(states)]
