"""Simpler explanations begun where the best has ended: what that holds in vain is dropped.

A fit of the start ends in the nearest of several minima. An explanation without a law may be worse
than one with it for nothing but its start.
"""

from __future__ import annotations

from collections.abc import Sequence

import torch
from torch import Tensor

from dashred.inference.fit.levenberg_marquardt import minimise
from dashred.inference.hypotheses.hypothesis_fit import HypothesisFit, by_score, ended
from dashred.inference.hypotheses.sensors.leave_one_sensor_out import beside_the_fault
from dashred.inference.initial_state.start_models import StartModel, project_state

STEPS, TOLERANCE = 10, 1e-4


def eliminate_terms(found: Sequence[HypothesisFit]) -> list[HypothesisFit]:
    """Return what explanations without a law become from the best one's start, if better.

    Args:
        found: explanations.
    """
    best = min(found, key=by_score)
    if not best.law.candidates:
        return []
    begun = [_begun(cause, best) for cause in found if _is_simpler(cause)]
    return [better for better in begun if better is not None]


def _is_simpler(cause: HypothesisFit) -> bool:
    """Tell whether an explanation has no law; what fitted a fault has told of it where it ended."""
    told = cause.law.fault is not None and cause.left_out is None
    return not cause.law.candidates and not told


def _begun(cause: HypothesisFit, best: HypothesisFit) -> HypothesisFit | None:
    """Return an explanation fitted from the best one's start; None where that is no better."""
    if cause.left_out is not None:
        bare = _begun(cause.left_out.bare, best)
        return bare and beside_the_fault(bare, cause.left_out.sensor)
    objective = cause.objective
    z = _start_of(best, objective.forward_model.start)
    phi = torch.cat([z, cause.phi[len(z) :]])
    before, there = objective.values(torch.stack([cause.phi, phi]))[0].tolist()
    if not there < before:
        return None
    return ended(cause, objective, minimise(objective, phi, STEPS, TOLERANCE))


def _start_of(cause: HypothesisFit, model: StartModel) -> Tensor:
    """Return an explanation's start as the z of a model, ``(mode,)``."""
    z, mine = cause.objective.split(cause.phi)[0], cause.objective.forward_model.start
    return z if mine is model else project_state(model, mine.start(z[None])[0])
