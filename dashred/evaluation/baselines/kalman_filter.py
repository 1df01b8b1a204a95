"""The ensemble Kalman filter of the state, and of the state with the coefficients of all terms.

Localisation, inflation and the prior std of the coefficients maximise the likelihood of the
innovations: they minimise ``Σ ln s + d²/2s²`` (d an innovation, s its expected std).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import product
from statistics import NormalDist

import torch
from torch import Tensor

from dashred.evaluation.baselines.estimate import Estimate, TermEntry
from dashred.evaluation.baselines.localisation import radii, radius_text
from dashred.inference.forward.stable_limit import stable_limit
from dashred.inference.initial_state.ensemble_filter import (
    FilterLostError,
    FilterResult,
    FilterSettings,
    ensemble_filter,
)
from dashred.physics.runs.ensemble import Ensemble, term_scales
from dashred.physics.system import Term
from dashred.physics.terms.library import resolve
from dashred.pipeline.problem import Problem

INFLATIONS = (1.0, 1.02, 1.1)
# Prior std of a coefficient, relative to the tendency; the last is that of the analysis.
WIDTHS = (0.03, 0.2, 1.0)
# Probability that any term of the law is spurious.
SIGNIFICANCE = 0.05


@dataclass(frozen=True)
class Trial:
    """One setting of the filter.

    Attributes:
        settings: localisation and inflation.
        coefficients: coefficients of the library's terms in each member; None for the state only.
        width: their prior std, relative to the tendencies of the equations.
    """

    settings: FilterSettings
    coefficients: Tensor | None = None
    width: float = 0.0


def filter_state(problem: Problem, ensemble: Ensemble) -> Estimate:
    """Return the filtered state of the unchanged simulator.

    Raises:
        FilterLostError: the filter is lost under every setting.
    """
    starts = ensemble.states[:, 0]
    filtered, trial = _most_likely(problem, starts, [Trial(each) for each in _settings(problem)])
    return Estimate(filtered.means, None, _note(starts, trial))


def filter_augmented(problem: Problem, ensemble: Ensemble, nominal: Tensor) -> Estimate:
    """Return state and law from a filter whose state includes the coefficients of all terms.

    The width of their prior is chosen first, then the radius, then the inflation.

    Args:
        problem: the recording.
        ensemble: plain simulations; the starts of its members are the prior of the state.
        nominal: the nominal run, ``(time, field, *grid)``, for the scales of the terms.

    Raises:
        FilterLostError: the filter is lost under every setting.
    """
    starts, reaches = ensemble.states[:, 0], radii(problem)
    drawn = [(width, _coefficients(problem, nominal, len(starts), width)) for width in WIDTHS]
    middle = _localised(reaches[len(reaches) // 2], INFLATIONS[len(INFLATIONS) // 2])
    _, trial = _most_likely(problem, starts, [Trial(middle, each, width) for width, each in drawn])
    settings = [_localised(radius, middle.inflation) for radius in reaches]
    _, trial = _most_likely(problem, starts, [replace(trial, settings=each) for each in settings])
    settings = [_localised(trial.settings.radius, inflation) for inflation in INFLATIONS]
    filtered, trial = _most_likely(
        problem, starts, [replace(trial, settings=each) for each in settings]
    )
    note = f"{_note(starts, trial)}, coefficients within {trial.width:g}"
    return Estimate(filtered.means, _law(problem.library, filtered), note)


def _coefficients(problem: Problem, nominal: Tensor, members: int, width: float) -> Tensor:
    """Draw the coefficient of each term in each member, ``(member, term)``.

    As in the analysis, their std is a share of the tendency of the equation, limited by the
    stability of a step.
    """
    system = problem.ensemble_system
    scales = term_scales(system, problem.library, nominal, problem.times[: len(nominal)])
    ready = resolve(system, problem.library)
    limits = torch.tensor([stable_limit(system, [term]) for term in ready], dtype=torch.float64)
    drawn = problem.rng("filter").standard_normal((members, len(ready)))
    return torch.from_numpy(drawn) * torch.minimum(width * scales, limits)


def _most_likely(
    problem: Problem, starts: Tensor, trials: Sequence[Trial]
) -> tuple[FilterResult, Trial]:
    """Return the run with the most likely innovations.

    Raises:
        FilterLostError: all runs are lost.
    """
    tried, last = [], "no innovation is finite"
    for trial in trials:
        try:
            filtered = _filter(problem, starts, trial.coefficients, trial.settings)
        except FilterLostError as lost:
            last = str(lost)
            continue
        if math.isfinite(cost := _negative_log_likelihood(filtered)):
            tried.append((cost, filtered, trial))
    if not tried:
        raise FilterLostError(f"lost under every setting: {last}")
    _, filtered, trial = min(tried, key=lambda each: each[0])
    return filtered, trial


def _note(starts: Tensor, trial: Trial) -> str:
    radius, inflation = trial.settings.radius, trial.settings.inflation
    return f"{len(starts)} members, {radius_text(radius)}, inflation {inflation:g}"


def _settings(problem: Problem) -> list[FilterSettings]:
    return [_localised(*each) for each in product(radii(problem), INFLATIONS)]


def _localised(radius: float, inflation: float) -> FilterSettings:
    return FilterSettings(radius=radius, start_radius=radius, inflation=inflation)


def _filter(
    problem: Problem, starts: Tensor, coefficients: Tensor | None, settings: FilterSettings
) -> FilterResult:
    fit = problem.split.fit
    return ensemble_filter(
        problem.ensemble_system,
        starts,
        coefficients,
        problem.library,
        problem.times[: len(fit.times)],
        torch.from_numpy(fit.values),
        problem.operator(fit),
        problem.noise_of(fit.names),
        settings,
    )


def _negative_log_likelihood(filtered: FilterResult) -> float:
    """Return the negative log-likelihood of the innovations, up to a constant."""
    seen = ~filtered.innovations.isnan()
    std = filtered.innovation_std[seen]
    return float((std.log() + (filtered.innovations[seen] / std).square() / 2).sum())


def _law(library: Sequence[Term], filtered: FilterResult) -> list[TermEntry]:
    """Return the significant terms, with a joint confidence of 95 %.

    At 95 % for each term, 2 of 40 absent terms would be significant by chance.
    """
    mean = filtered.coefficients_mean
    std = filtered.coefficients_anomalies.square().mean(dim=0).sqrt()
    least = NormalDist().inv_cdf(1 - SIGNIFICANCE / (2 * max(1, len(library))))
    return [
        TermEntry(equation=term.equation, term=str(term), coefficient=float(mean[j]))
        for j, term in enumerate(library)
        if abs(mean[j]) > least * std[j]
    ]
