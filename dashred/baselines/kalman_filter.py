"""The ensemble Kalman filter: of the state alone, and with the coefficients of all terms.

Localisation and inflation are chosen by the filter's own innovations: the setting under which
they are likeliest, ``Σ ln s + d²/2s²`` over all of them (d an innovation, s its expected std).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import product

import torch
from torch import Tensor

from dashred.baselines.estimate import Estimated, TermEntry
from dashred.discovery.ensemble_filter import (
    Filtered,
    FilterLostError,
    FilterSettings,
    ensemble_filter,
)
from dashred.discovery.law import Z95
from dashred.physics.ensemble import Ensemble
from dashred.physics.system import Term
from dashred.stages.problem import Problem

INFLATIONS = (1.0, 1.02, 1.1)
# Of the longest axis.
RADII = (math.inf, 0.3, 0.15)


def filter_state(problem: Problem, ensemble: Ensemble) -> Estimated:
    """Return the filtered state of the simulator as it is.

    Raises:
        FilterLostError: under every setting.
    """
    filtered, note = _likeliest(problem, ensemble.states[:, 0], None)
    return Estimated(filtered.means, None, note)


def filter_augmented(problem: Problem, ensemble: Ensemble) -> Estimated:
    """Return state and law, where each member carries coefficients that it learns.

    Args:
        problem: the recording.
        ensemble: its members' starts and coefficients, which are the prior.

    Raises:
        FilterLostError: under every setting.
    """
    filtered, note = _likeliest(problem, ensemble.states[:, 0], ensemble.coefficients)
    return Estimated(filtered.means, _law(problem.library, filtered), note)


def _likeliest(
    problem: Problem, starts: Tensor, coefficients: Tensor | None
) -> tuple[Filtered, str]:
    tried, last = [], "no innovation is finite"
    for settings in _settings(problem):
        try:
            filtered = _filter(problem, starts, coefficients, settings)
        except FilterLostError as lost:
            last = str(lost)
            continue
        if math.isfinite(surprise := _surprise(filtered)):
            tried.append((surprise, filtered, settings))
    if not tried:
        raise FilterLostError(f"lost under every setting: {last}")
    _, filtered, settings = min(tried, key=lambda each: each[0])
    radius = f"radius {settings.radius:g}" if math.isfinite(settings.radius) else "not localised"
    return filtered, f"{len(starts)} members, {radius}, inflation {settings.inflation:g}"


def _settings(problem: Problem) -> list[FilterSettings]:
    longest = max((axis.length for axis in problem.system.axes), default=math.inf)
    radii = dict.fromkeys(share * longest for share in RADII)
    return [
        FilterSettings(radius=radius, start_radius=radius, inflation=inflation)
        for radius, inflation in product(radii, INFLATIONS)
    ]


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
    mean = filtered.coefficients_mean
    std = filtered.coefficients_anomalies.square().mean(dim=0).sqrt()
    return [
        TermEntry(equation=term.equation, term=str(term), coefficient=float(mean[j]))
        for j, term in enumerate(library)
        if abs(mean[j]) > Z95 * std[j]
    ]
