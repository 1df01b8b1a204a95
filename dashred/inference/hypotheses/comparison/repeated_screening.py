"""Screen again on top of the best law, while a free forcing still gains there.

See docs/method.md#repeated-screening.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

from torch import Tensor

from dashred.core.progress import Report
from dashred.inference.hypotheses.free_forcing import FreeForcing, force
from dashred.inference.hypotheses.hypothesis_fit import HypothesisFit, by_score
from dashred.inference.hypotheses.result import MISSING

# How often terms are screened anew about a better law's trajectory.
ROUNDS = 3


def repeat_screening(
    best: HypothesisFit,
    screened: Callable[[FreeForcing, float], list[HypothesisFit]],
    carriers: Sequence[FreeForcing],
    size: Tensor,
    report: Report,
) -> tuple[list[HypothesisFit], HypothesisFit, FreeForcing, float]:
    """Screen, and screen again about the best law's trajectory while a free forcing gains there.

    A law that is nearly right, under a forcing, comes nearer to the truth than a forcing alone,
    which is as coarse as its cells
    (docs/method.md#repeated-screening). So about one in a window terms are screened
    again in any case.

    Args:
        best: the best law so far.
        screened: laws found about a trajectory, of those whose linearised score is below a bound.
        carriers: of the first trajectories: the next is asked where one has led to nothing better.
        size: rms of each equation's own tendency, ``(equation,)``.
        report: progress.

    Returns:
        the laws, the best law now, the forcing that came nearest to the recording, and what one
        gains on top of the best law.
    """
    found: list[HypothesisFit] = []
    for carrier in carriers:
        found += screened(carrier, math.inf)
        if min([best, *found], key=by_score) is not best:
            break
    first = min([best, *found], key=by_score)
    on_first, gain = force(first.objective, first.phi, size)
    for turn in range(ROUNDS):
        # One in a window may imitate what the first trajectory was too far from the truth to show.
        if gain <= MISSING and (turn or first.law.window is None):
            break
        report(0.6 + 0.05 * turn, f"a forcing gains {gain:.0f} on {first.law}: screening on top")
        found += screened(on_first, first.law.score)
        nearest = min([first, *found], key=by_score)
        if nearest is first:
            break
        first = nearest
        on_first, gain = force(first.objective, first.phi, size)
    nearest_forced = min(*carriers, on_first, key=lambda each: each.cost)
    return found, first, nearest_forced, gain
