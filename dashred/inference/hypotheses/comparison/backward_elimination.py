"""Backward elimination: refit hypotheses without terms from the initial state of the best one.

A fit ends in the nearest of several minima. A hypothesis without terms may therefore score worse
than one with terms only because its fit began elsewhere.
"""

from __future__ import annotations

from collections.abc import Sequence

import torch

from dashred.inference.fit.levenberg_marquardt import minimise
from dashred.inference.hypotheses.hypothesis_fit import HypothesisFit, by_score, replace_minimum
from dashred.inference.hypotheses.sensors.excluded_sensors import add_faults

STEPS, TOLERANCE = 10, 1e-4


def eliminate_terms(fits: Sequence[HypothesisFit]) -> list[HypothesisFit]:
    """Refit hypotheses without terms from the best one's initial state; return those that improve.

    Args:
        fits: hypotheses.
    """
    best = min(fits, key=by_score)
    if not best.law.candidates:
        return []
    refits = [_refit_from(fit, best) for fit in fits if _can_be_refitted(fit)]
    return [fit for fit in refits if fit is not None]


def _can_be_refitted(fit: HypothesisFit) -> bool:
    """Tell whether a hypothesis has no terms, and no fault among its unknowns."""
    return not fit.law.candidates and not fit.faults


def _refit_from(fit: HypothesisFit, best: HypothesisFit) -> HypothesisFit | None:
    """Return a hypothesis fitted from the best one's initial state; None if F does not improve."""
    if fit.excluded is not None:
        without_faults = _refit_from(fit.excluded.without_faults, best)
        return without_faults and add_faults(without_faults, fit.excluded.sensors)
    objective = fit.objective
    z, _ = best.objective.split(best.phi)
    z = best.objective.forward_model.move_to(objective.forward_model.start, z)
    phi = torch.cat([z, fit.phi[len(z) :]])
    before, after = objective.values(torch.stack([fit.phi, phi]))[0].tolist()
    if not after < before:
        return None
    return replace_minimum(fit, objective, minimise(objective, phi, STEPS, TOLERANCE))
