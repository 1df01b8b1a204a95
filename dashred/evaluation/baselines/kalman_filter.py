"""The ensemble Kalman filter: of the state alone, and with the coefficients of all terms.

Localisation, inflation, and how wide the coefficients are drawn, are chosen by the filter's own
innovations: the setting under which they are likeliest, ``Σ ln s + d²/2s²`` over all of them (d an
innovation, s its expected std).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import product
from statistics import NormalDist

import torch
from torch import Tensor

from dashred.evaluation.baselines.estimate import Estimated, TermEntry
from dashred.evaluation.baselines.localisation import radii, radius_in_words
from dashred.inference.forward.candidates import stable_limit
from dashred.inference.initial_state.ensemble_filter import (
    Filtered,
    FilterLostError,
    FilterSettings,
    ensemble_filter,
)
from dashred.physics.library import resolve
from dashred.physics.runs.ensemble import Ensemble, term_scales
from dashred.physics.system import Term
from dashred.pipeline.problem import Problem

INFLATIONS = (1.0, 1.02, 1.1)
# Prior std of a coefficient, told by the tendency that it makes: the last is that of our own fit.
WIDTHS = (0.03, 0.2, 1.0)
# That any term of the law is spurious.
DOUBT = 0.05


@dataclass(frozen=True)
class Trial:
    """One way to run the filter.

    Attributes:
        settings: localisation and inflation.
        coefficients: of the library's terms in each member; None for the state alone.
        width: their prior std, in the equations' tendencies.
    """

    settings: FilterSettings
    coefficients: Tensor | None = None
    width: float = 0.0


def filter_state(problem: Problem, ensemble: Ensemble) -> Estimated:
    """Return the filtered state of the simulator as it is.

    Raises:
        FilterLostError: under every setting.
    """
    starts = ensemble.states[:, 0]
    filtered, trial = _likeliest(problem, starts, [Trial(each) for each in _settings(problem)])
    return Estimated(filtered.means, None, _note(starts, trial))


def filter_augmented(problem: Problem, ensemble: Ensemble, nominal: Tensor) -> Estimated:
    """Return state and law, where each member carries coefficients of all terms and learns them.

    How wide they are drawn is chosen like the other settings: first it, then the radius, then the
    inflation.

    Args:
        problem: the recording.
        ensemble: plain simulations: its members' starts are the prior of the state.
        nominal: the nominal simulation, ``(time, field, *grid)``, which tells a term's scale.

    Raises:
        FilterLostError: under every setting.
    """
    starts, reaches = ensemble.states[:, 0], radii(problem)
    drawn = [(width, _coefficients(problem, nominal, len(starts), width)) for width in WIDTHS]
    middle = _localised(reaches[len(reaches) // 2], INFLATIONS[len(INFLATIONS) // 2])
    _, trial = _likeliest(problem, starts, [Trial(middle, each, width) for width, each in drawn])
    settings = [_localised(radius, middle.inflation) for radius in reaches]
    _, trial = _likeliest(problem, starts, [replace(trial, settings=each) for each in settings])
    settings = [_localised(trial.settings.radius, inflation) for inflation in INFLATIONS]
    filtered, trial = _likeliest(
        problem, starts, [replace(trial, settings=each) for each in settings]
    )
    note = f"{_note(starts, trial)}, coefficients within {trial.width:g}"
    return Estimated(filtered.means, _law(problem.library, filtered), note)


def _coefficients(problem: Problem, nominal: Tensor, members: int, width: float) -> Tensor:
    """Draw each term's coefficient in each member, ``(member, term)``.

    As for our own fit their std is a share of the equation's tendency, or the largest with which a
    step stays stable.
    """
    system = problem.ensemble_system
    scales = term_scales(system, problem.library, nominal, problem.times[: len(nominal)])
    ready = resolve(system, problem.library)
    limits = torch.tensor([stable_limit(system, [term]) for term in ready], dtype=torch.float64)
    drawn = problem.rng("filter").standard_normal((members, len(ready)))
    return torch.from_numpy(drawn) * torch.minimum(width * scales, limits)


def _likeliest(problem: Problem, starts: Tensor, trials: Sequence[Trial]) -> tuple[Filtered, Trial]:
    """Return the run whose innovations are likeliest.

    Raises:
        FilterLostError: every one is lost.
    """
    tried, last = [], "no innovation is finite"
    for trial in trials:
        try:
            filtered = _filter(problem, starts, trial.coefficients, trial.settings)
        except FilterLostError as lost:
            last = str(lost)
            continue
        if math.isfinite(surprise := _surprise(filtered)):
            tried.append((surprise, filtered, trial))
    if not tried:
        raise FilterLostError(f"lost under every setting: {last}")
    _, filtered, trial = min(tried, key=lambda each: each[0])
    return filtered, trial


def _note(starts: Tensor, trial: Trial) -> str:
    radius, inflation = trial.settings.radius, trial.settings.inflation
    return f"{len(starts)} members, {radius_in_words(radius)}, inflation {inflation:g}"


def _settings(problem: Problem) -> list[FilterSettings]:
    return [_localised(*each) for each in product(radii(problem), INFLATIONS)]


def _localised(radius: float, inflation: float) -> FilterSettings:
    return FilterSettings(radius=radius, start_radius=radius, inflation=inflation)


def _filter(
    problem: Problem, starts: Tensor, coefficients: Tensor | None, settings: FilterSettings
) -> Filtered:
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


def _surprise(filtered: Filtered) -> float:
    """Return the innovations' negative log-likelihood, but for a constant."""
    seen = ~filtered.innovations.isnan()
    std = filtered.innovation_std[seen]
    return float((std.log() + (filtered.innovations[seen] / std).square() / 2).sum())


def _law(library: Sequence[Term], filtered: Filtered) -> list[TermEntry]:
    """Return the terms that are not zero, all of them together with a confidence of 95 %.

    Of 40 terms that are not there, two would each pass 95 % alone.
    """
    mean = filtered.coefficients_mean
    std = filtered.coefficients_anomalies.square().mean(dim=0).sqrt()
    least = NormalDist().inv_cdf(1 - DOUBT / (2 * max(1, len(library))))
    return [
        TermEntry(equation=term.equation, term=str(term), coefficient=float(mean[j]))
        for j, term in enumerate(library)
        if abs(mean[j]) > least * std[j]
    ]
