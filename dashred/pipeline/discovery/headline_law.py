"""The law in the headline: of a law of many terms, those that its forecast needs."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

from torch import Tensor

from dashred.inference.fit.fitted_law import build_law
from dashred.inference.fit.forecast_choice import (
    FITTED_SHARE,
    MOST_TERMS,
    Forecast,
    forecast_of,
    smallest_sufficient,
)
from dashred.inference.fit.law import Law
from dashred.inference.fit.least_squares import LeastSquaresProblem
from dashred.inference.fit.levenberg_marquardt import minimise
from dashred.inference.fit.selection.stepwise_selection import RefittedSet, Selection, term_penalty
from dashred.inference.forward.candidates import Candidate
from dashred.inference.hypotheses.hypothesis_fit import HypothesisFit
from dashred.inference.hypotheses.result import Discovery

STEPS, TOLERANCE = 10, 1e-4


@dataclass(frozen=True)
class Headline:
    """The law of a few terms in place of one of many.

    Attributes:
        fit: its fit.
        further_gain: evidence that the other terms of the larger law gain.
    """

    fit: HypothesisFit
    further_gain: float


def headline_law(selection: Selection, score: float) -> Headline | None:
    """Return the smallest law that forecasts as well as any of a few terms.

    Args:
        selection: fits of sets of candidates, the best first.
        score: of the best law.

    Returns:
        The law, with that score; None if the best law itself has few terms.
    """
    objective, path = selection.objective, _best_by_size(selection.tried)
    if len(selection.tried[0].members) <= MOST_TERMS or not path:
        return None
    chosen = path[smallest_sufficient([_forecast(objective, each) for each in path])]
    law = objective.subset(chosen.members)
    fitted = minimise(law, chosen.phi[objective.indices(chosen.members)], STEPS, TOLERANCE)
    own_score = fitted.cost + term_penalty(objective) * len(chosen.members)
    told = HypothesisFit(build_law(law, fitted, score), law, fitted.phi)
    return Headline(told, own_score - selection.tried[0].score)


def with_headline(discovery: Discovery, told: Law, forcing_gain: float) -> Discovery:
    """Return the discovery with a part of its best law in the headline.

    A law of a few terms, and a law in a window or of a source, stays as it is.

    Args:
        discovery: its best law may have many terms.
        told: the law of a few terms.
        forcing_gain: evidence for what it leaves unexplained.
    """
    best = discovery.best
    if len(best.candidates) <= MOST_TERMS or best.window is not None or best.source is not None:
        return discovery
    told = replace(told, faults=best.faults)
    smaller = [law for law in discovery.laws[1:] if len(law.candidates) <= len(told.candidates)]
    kept = [law for law in smaller if law.keys != told.keys]
    return replace(
        discovery,
        laws=[told, *kept],
        also_supported=terms_beside(told, best.candidates, best.coefficients.tolist()),
        free_chi2=told.chi2,
        forcing_gain=forcing_gain,
    )


def terms_beside(
    told: Law, candidates: Sequence[Candidate], coefficients: Iterable[float]
) -> tuple[tuple[Candidate, float], ...]:
    """Return the terms of a larger law that the law of the headline does not contain.

    Args:
        told: the law of the headline.
        candidates: terms of the larger law.
        coefficients: their coefficients.
    """
    pairs = zip(candidates, map(float, coefficients), strict=True)
    return tuple(pair for pair in pairs if pair[0].key not in told.keys)


def _best_by_size(tried: Sequence[RefittedSet]) -> list[RefittedSet]:
    """Return the best set of each size, up to a few candidates."""
    best: dict[int, RefittedSet] = {}
    for each in sorted(tried, key=lambda found: found.cost):
        best.setdefault(len(each.members), each)
    return [best[size] for size in sorted(best) if 0 < size <= MOST_TERMS]


def _forecast(objective: LeastSquaresProblem, tried: RefittedSet) -> Forecast:
    """Return the forecast of the last part of the record, from a fit of one set to the rest."""
    law = objective.subset(tried.members)
    samples = round(FITTED_SHARE * len(objective.recorded))
    begin = tried.phi[objective.indices(tried.members)]
    fitted = minimise(law.truncate(samples), begin, STEPS, TOLERANCE)
    [readings] = law.forward_model.readings(*(part[None] for part in law.split(fitted.phi)))
    return forecast_of(_scaled_errors(law, readings)[samples:])


def _scaled_errors(law: LeastSquaresProblem, readings: Tensor) -> Tensor:
    # After a blow-up the readings are NaN.
    errors = (readings - law.recorded) / law.noise.std
    return errors.where(errors.isfinite(), math.inf).where(law.noise.available, math.nan)
