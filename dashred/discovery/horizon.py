"""Walk the fit from the first samples to the whole record: a growing horizon, with annealing.

Over a long stretch the misfit of a wrong start has countless false minima; over a short one
it has none, and its solution is a good beginning for a slightly longer one (design §4.2.2-4).
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from statistics import median

import torch
from torch import Tensor

from dashred.discovery.gauss_newton import Fitted, Objective, minimise

GROWTH = 1.3
# A stage that fails is tried again with a shorter stretch.
SMALLEST_GROWTH = 1.03
# Misfit, relative to the level so far, at which a stage has lost the trajectory.
LOST = 1.3
# σ of the first window, in the traces' std, then in the noise's own.
ANNEALING = (1.0, 0.3, 0.1, 0.03)
FINAL_ANNEALING = (2.0, 1.0)
STAGE_STEPS = 6
ANNEALING_STEPS = 2
# A step that gains less ends a stage: the next stage moves everything anyway.
TOLERANCE = 0.02

Report = Callable[[float, str], None]


@dataclass(frozen=True)
class Walk:
    """How far a walk came.

    Attributes:
        fitted: the fit at the last horizon reached.
        samples: that horizon.
        reached: whether it is the whole record.
        levels: ``(samples, χ²/n)`` of each stage.
    """

    fitted: Fitted
    samples: int
    reached: bool
    levels: list[tuple[int, float]]


def first_samples(objective: Objective) -> int:
    """Return how many samples determine the start: three readings for each of its modes."""
    sensors = objective.recorded.shape[1]
    total = len(objective.recorded)
    return min(total, max(6, math.ceil(3 * objective.modes / sensors)))


def fit_first_window(objective: Objective, trace_std: Tensor) -> Fitted:
    """Fit the start alone to the first samples, from coarse to fine.

    Args:
        objective: F over the whole record.
        trace_std: std of each sensor's trace, ``(sensor,)``.
    """
    window = objective.only([]).until(first_samples(objective))
    noise = window.noise
    ratio = float((noise.std / trace_std.clamp(min=1e-300)).median())
    rough = [a for a in ANNEALING if a > FINAL_ANNEALING[0] * ratio]
    coarse = [replace(noise, std=torch.maximum(a * trace_std, noise.std)) for a in rough]
    fine = [noise.scaled(a) for a in FINAL_ANNEALING]
    phi = torch.zeros(objective.modes, dtype=torch.float64)
    for annealed in (*coarse, *fine):
        fitted = minimise(replace(window, noise=annealed), phi, ANNEALING_STEPS, TOLERANCE)
        phi = fitted.phi
    return fitted


def walk(objective: Objective, phi: Tensor, samples: int, report: Report) -> Walk:
    """Extend the horizon while the misfit stays near its level so far.

    Args:
        objective: F over the whole record, with a tight prior on ξ.
        phi: a fit of the first samples, ``(unknown,)``.
        samples: how many these are.
        report: progress.
    """
    total = len(objective.recorded)
    fitted = minimise(objective.until(samples), phi, STAGE_STEPS, TOLERANCE)
    levels = [(samples, _level(objective, fitted, samples))]
    growth = GROWTH
    while samples < total and growth > SMALLEST_GROWTH:
        further = min(total, max(samples + 1, round(samples * growth)))
        steps = STAGE_STEPS if growth == GROWTH else 2 * STAGE_STEPS
        tried = minimise(objective.until(further), fitted.phi, steps, TOLERANCE)
        level = _level(objective, tried, further)
        usual = max(1.0, median(past for _, past in levels))
        if level <= LOST * usual:
            fitted, samples = tried, further
            levels.append((samples, level))
            growth = GROWTH
            report(samples / total, f"horizon {samples} of {total}, χ²/n {level:.2f}")
        else:
            growth = 1 + (growth - 1) / 2
    return Walk(fitted, samples, samples == total, levels)


def _level(objective: Objective, fitted: Fitted, samples: int) -> float:
    return fitted.chi2 / max(1, objective.noise.first(samples).count)
