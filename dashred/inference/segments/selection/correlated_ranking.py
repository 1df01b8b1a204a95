"""Rank the laws of a search whose residuals are correlated from sample to sample."""

from __future__ import annotations

from dataclasses import replace

from dashred.inference.segments.selection.correlated_noise import (
    correlated_score,
    residual_moments,
)
from dashred.inference.segments.selection.search import SegmentSearch
from dashred.inference.segments.selection.set_selection import SegmentLaw, refit_small_sets


def has_correlated_residuals(found: SegmentSearch) -> bool:
    """Tell whether the residuals of the best law are correlated."""
    best = found.best
    return residual_moments(found.problem, best.members, best.fit).redundancy > 1.0


def rank_correlated(found: SegmentSearch) -> SegmentSearch:
    """Return the laws ranked under correlated noise, with further sets of a few terms.

    After the deadline of the search no further sets are refitted.

    Args:
        found: the search under white noise.
    """
    problem = found.problem
    fits = {law.members: law.fit for law in found.laws}
    refit_small_sets(problem, found.best, fits)
    laws = [
        SegmentLaw(members, fit, correlated_score(problem, members, fit, found.price))
        for members, fit in fits.items()
    ]
    return replace(found, laws=sorted(laws, key=lambda law: law.score))
