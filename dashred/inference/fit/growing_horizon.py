"""Extend a fit from the first samples to the whole record: a growing horizon.

Over a long stretch the misfit of a wrong start has many false minima. Over a short one it has none,
and its solution is a good first guess for a slightly longer one (docs/method.md#growing-horizon).
Where the narrow prior of the coefficients forbids the law, the evidence widens it for a few.
"""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass

from torch import Tensor

from dashred.core.budget import OutOfTimeError
from dashred.core.progress import Report
from dashred.inference.fit.horizon_state import STAGE_STEPS, HorizonState
from dashred.inference.fit.least_squares import LeastSquaresProblem
from dashred.inference.fit.selection.subset_search import most_distinct_candidates

GROWTH = 1.3
# A stage that fails is fitted again with less growth, down to this.
SMALLEST_GROWTH = 1.03
# The candidates are chosen again whenever the horizon has grown by this factor, as long as it still
# has to grow by it.
REGROWTH = 2
# How often further candidates are added after stages have failed.
MOST_ADDITIONS = 2
# The growth ends when it has cost as much as this many Jacobians over the whole record.
EFFORT = 40


@dataclass(frozen=True)
class HorizonFit:
    """The fit at the last horizon reached.

    Attributes:
        phi: unknowns of the fit, with all candidates, ``(unknown,)``.
        members: indices of the fitted candidates.
        readings: readings of the fit, ``(time, sensor)``.
        samples: the last horizon.
        is_complete: whether the last horizon is the whole record.
        levels: ``(samples, χ²/n)`` of each stage.
        widened: indices of the candidates whose prior the evidence widened, or of the law that was
            found over segments.
        widest: the largest factor by which their prior exceeds the tight one.
    """

    phi: Tensor
    members: tuple[int, ...]
    readings: Tensor
    samples: int
    is_complete: bool
    levels: list[tuple[int, float]]
    widened: tuple[int, ...] = ()
    widest: float = 1.0


def fit_first_horizon(
    objective: LeastSquaresProblem, phi: Tensor, samples: int, count: int
) -> HorizonState:
    """Fit the first samples with the candidates that have the most distinct effects.

    They can represent the others over the next stretch. If χ²/n is larger than noise explains, the
    prior is widened for the candidates that need it.

    Args:
        objective: F over the whole record, with a tight prior on ξ.
        phi: a fit of the first samples, ``(unknown,)``.
        samples: number of the first samples.
        count: number of candidates in the fit.
    """
    members = most_distinct_candidates(objective, phi, samples, count)
    state = HorizonState(objective, phi, samples, members)
    state.fit_first()
    return state


def grow_horizon(state: HorizonState, count: int, report: Report) -> HorizonFit:
    """Extend the horizon while the misfit stays near its typical level.

    If stages fail, the prior is widened for the candidates that need it, or further candidates are
    added. At the deadline of F the horizon stays where it is.

    Args:
        state: the fit of the first samples; changed in place.
        count: number of candidates in the fit.
        report: progress.
    """
    with suppress(OutOfTimeError):
        _extend(state, count, report)
    return HorizonFit(
        state.phi,
        state.members,
        state.readings,
        state.samples,
        state.samples == len(state.objective.recorded),
        state.levels,
        state.widened,
        state.widest,
    )


def _extend(state: HorizonState, count: int, report: Report) -> None:
    """Extend the horizon as far as possible; arguments as in :func:`grow_horizon`.

    Raises:
        OutOfTimeError: the deadline of F is over; the state is that of the last horizon reached.
    """
    total = len(state.objective.recorded)
    chosen, additions, growth = state.samples, 0, GROWTH
    while state.samples < total and state.effort < EFFORT * total:
        if REGROWTH * chosen <= state.samples <= total / REGROWTH and growth == GROWTH:
            chosen = state.samples
            state.choose_candidates(count)
        further = min(total, max(state.samples + 1, round(state.samples * growth)))
        if state.advance(further, STAGE_STEPS if growth == GROWTH else 2 * STAGE_STEPS):
            growth = GROWTH
            state.reconsider()
            report(further / total, f"horizon {further} of {total}, χ²/n {state.levels[-1][1]:.2f}")
            continue
        growth = 1 + (growth - 1) / 2
        is_stuck = growth <= SMALLEST_GROWTH
        # Widths that the evidence has chosen before may have to change at any failure.
        if (is_stuck or state.widened) and state.widen(further):
            growth = GROWTH
        elif is_stuck and additions < MOST_ADDITIONS:
            state.add_candidates(count)
            additions, growth = additions + 1, GROWTH
        elif is_stuck:
            break
