"""The laws of a selection: the best and the empty one, converged, and the best of each size."""

from __future__ import annotations

import math
from collections.abc import Sequence

from torch import Tensor

from dashred.inference.fit.fitted_law import build_selected_law
from dashred.inference.fit.law import Law
from dashred.inference.fit.least_squares import LeastSquaresProblem
from dashred.inference.fit.selection.nested_fits import RoomLeft, room_left
from dashred.inference.fit.selection.stepwise_selection import (
    RefittedSet,
    Selection,
    choose_better,
    polish,
)
from dashred.inference.hypotheses.result import BestOfSize
from dashred.inference.results.verdict import STUCK

# Relative decrease of F at which a fit ends. The fit without a law needs less accuracy, because its
# misfit is large.
LAW_TOLERANCE, EMPTY_TOLERANCE = 1e-5, 1e-3
# Number of alternative laws that are kept, and their largest distance in score from the best law.
MAX_RIVALS = 6
RIVAL_MARGIN = 12.0


def fit_best(selection: Selection) -> tuple[list[Law], list[RefittedSet], RefittedSet, Law]:
    """Converge the fits of the best law and of the empty law; the alternatives are not refitted.

    Returns:
        The laws, the best first; their fits; the fit of the empty law; and the empty law.
    """
    objective = selection.objective
    best = polish(objective, selection.tried[0], LAW_TOLERANCE)
    normal = objective.linearise(best.phi)
    near = [t for t in selection.tried[1:] if t.score < best.score + RIVAL_MARGIN][:MAX_RIVALS]
    single = next((t for t in selection.tried if len(t.members) == 1), None)
    if single is not None and len(best.members) > 1 and all(t is not single for t in near):
        near.append(single)
    nothing = (
        polish(objective, _empty_law(selection, best), EMPTY_TOLERANCE) if best.members else best
    )

    def law(tried: RefittedSet) -> Law:
        [readings] = objective.forward_model.readings(*objective.split(tried.phi[None]))
        return build_selected_law(
            objective, normal, tried.phi, tried.members, readings, tried.score
        )

    ranked = sorted([best, *near], key=lambda tried: tried.score)
    return [law(tried) for tried in ranked], ranked, nothing, law(nothing)


def _empty_law(selection: Selection, best: RefittedSet) -> RefittedSet:
    """Return the empty law with its own start or with that of the best law, if it fits better."""
    objective = selection.objective
    own = next(tried for tried in selection.tried if not tried.members)
    other = objective.embed(best.phi[: objective.modes], [])
    phi, cost = choose_better(objective, own.phi, other)
    return RefittedSet((), phi, cost, cost)


def room_left_for(
    objective: LeastSquaresProblem,
    fits: Sequence[RefittedSet],
    law: Law,
    free: Tensor,
    free_chi2: float,
) -> RoomLeft | None:
    """Return what the fit of a law could still gain, if its misfit is far above the lowest.

    Args:
        objective: F of all candidates.
        fits: fits of sets of candidates.
        law: one of these sets, or another hypothesis.
        free: readings of the fit of all candidates, ``(time, sensor)``.
        free_chi2: χ²/n of that fit.

    Returns:
        None if the misfit is near the lowest, or for another hypothesis.
    """
    is_other = law.faults or law.window or law.source or law.start_prior_factor > 1
    if is_other or law.chi2 <= STUCK * free_chi2:
        return None
    known = objective.forward_model.law.candidates
    same = [fit for fit in fits if {known[j].key for j in fit.members} == law.keys]
    return room_left(objective, same[0], free) if same else None


def best_by_size(selection: Selection, nothing: RefittedSet) -> list[BestOfSize]:
    """Return the best law of each size; the empty law is the converged one."""
    objective = selection.objective
    known = objective.forward_model.law.candidates
    best: dict[int, RefittedSet] = {}
    for tried in (nothing, *selection.tried):
        if math.isfinite(tried.score):
            best.setdefault(len(tried.members), tried)
    return [
        BestOfSize(
            tuple(known[j] for j in tried.members),
            tuple(float(tried.phi[objective.modes + j]) for j in tried.members),
            tried.score,
            math.sqrt(tried.cost / objective.noise.count),
        )
        for _, tried in sorted(best.items())
    ]
