"""Screen repeatedly about the best law while a free forcing on top of it gains evidence.

See docs/method.md#repeated-screening.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

from torch import Tensor

from dashred.core.budget import OutOfTimeError
from dashred.core.progress import Report
from dashred.inference.hypotheses.free_forcing import FreeForcing, fit_free_forcing
from dashred.inference.hypotheses.hypothesis_fit import HypothesisFit, by_score
from dashred.inference.hypotheses.result import MIN_FORCING_GAIN

# Maximum number of screenings about the trajectory of a better law.
MAX_ROUNDS = 3


def repeat_screening(
    best: HypothesisFit,
    screen: Callable[[FreeForcing, float], list[HypothesisFit]],
    forcings: Sequence[FreeForcing],
    forcing_gain: float,
    tendency_rms: Tensor,
    report: Report,
) -> tuple[list[HypothesisFit], HypothesisFit, FreeForcing, float]:
    """Screen about free forcings, then about the best law while a forcing on top of it gains.

    A nearly right law under a forcing comes closer to the truth than a forcing alone, because a
    forcing is as coarse as its cells (docs/method.md#repeated-screening). Terms are therefore
    always screened again about a law in a window.

    Args:
        best: the best law so far.
        screen: returns the laws found about a trajectory with a linearised score below a bound.
        forcings: of the first trajectories. The next one is used only if the one before led to no
            better law.
        forcing_gain: evidence that the last of them gains.
        forcing_gain: evidence that a forcing gains on top of the best law before the screening.
        tendency_rms: rms of each equation's own tendency, ``(equation,)``.
        report: progress.

    Returns:
        The laws, the best law, the forcing with the lowest F, and the evidence that a forcing gains
        on top of the best law.
    """
    fits: list[HypothesisFit] = []
    for forcing in forcings:
        fits += screen(forcing, math.inf)
        if min([best, *fits], key=by_score) is not best:
            break
    best_fit = min([best, *fits], key=by_score)
    forcing_on_best, gain = _force(best_fit, tendency_rms, (forcings[-1], forcing_gain))
    for round_index in range(MAX_ROUNDS):
        # The first trajectory may have been too far from the truth: a law in a window may imitate
        # another law.
        if gain <= MIN_FORCING_GAIN and (round_index or best_fit.law.window is None):
            break
        report(
            0.6 + 0.05 * round_index,
            f"evidence for a forcing beyond {best_fit.law}: {gain:.0f}; screening",
        )
        fits += screen(forcing_on_best, best_fit.law.score)
        new_best = min([best_fit, *fits], key=by_score)
        if new_best is best_fit:
            break
        best_fit = new_best
        forcing_on_best, gain = _force(best_fit, tendency_rms, (forcing_on_best, gain))
    nearest_forcing = min(*forcings, forcing_on_best, key=lambda each: each.cost)
    return fits, best_fit, nearest_forcing, gain


def _force(
    fit: HypothesisFit, tendency_rms: Tensor, known: tuple[FreeForcing, float]
) -> tuple[FreeForcing, float]:
    """Return a free forcing on top of a law; the known one if there is no time for it."""
    try:
        return fit_free_forcing(fit.objective, fit.phi, tendency_rms)
    except OutOfTimeError:
        return known
