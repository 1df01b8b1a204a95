"""Select again in the unit of an unread field in which fewer terms are needed."""

from __future__ import annotations

from dashred.inference.segments.natural_scales import NaturalScales, natural_scales
from dashred.inference.segments.selection.rescaled_laws import RescaledLaw, rescaled_laws
from dashred.inference.segments.selection.search import PRIOR, SELECTION, SegmentSearch, weighted
from dashred.inference.segments.selection.set_selection import REFITTED, refit, select, term_price


def in_plainer_unit(found: SegmentSearch) -> SegmentSearch:
    """Return a search in another unit of an unread field, if its best law has fewer terms.

    The scales of an unread field come from a first guess. If this is far off, the weights of F
    prefer the law in a unit in which the field is as large as guessed, even if it needs more terms
    there. In the other unit, the scales are those of the states of the law. The prior of the start
    is in the unit of the simulator in both.

    Args:
        found: the search.
    """
    best = found.best
    for law in rescaled_laws(found.problem, best.members, best.fit):
        natural = _scales_of(found, law)
        problem = weighted(found.problem, natural, SELECTION, PRIOR)
        begun = refit(problem, law.point, law.members)
        proposals = [law.members, *(each.members for each in found.laws[:REFITTED])]
        laws = select(problem, problem, begun.point, proposals)
        saved = len(best.members) - len(laws[0].members)
        largest = best.fit.cost + saved * found.level * term_price(problem)
        if problem.deadline.is_over:
            break
        if saved > 0 and laws[0].fit.cost < largest:
            return SegmentSearch(problem, natural, laws)
    return found


def _scales_of(found: SegmentSearch, law: RescaledLaw) -> NaturalScales:
    """Return the natural scales at the states of a law."""
    problem, size = found.problem, found.natural.size.copy()
    size[law.field] *= abs(law.unit)
    return natural_scales(
        problem.simulator,
        problem.sensors,
        problem.candidates,
        law.point.nodes,
        size,
        problem.noise_std,
    )
