"""Fit a start to the first samples alone, from coarse to fine."""

from __future__ import annotations

from dataclasses import replace

import torch
from torch import Tensor

from dashred.inference.fit.least_squares import LeastSquaresProblem
from dashred.inference.fit.levenberg_marquardt import FitResult, minimise

# Over longer stretches a front that is a little off, or chaos, has many false minima. What so few
# readings leave open of the start the prior holds until there are more, however many modes it has.
SAMPLES = 6
# σ of the first window, in the traces' std, then in the noise's own.
ANNEALING = (1.0, 0.3, 0.1, 0.03)
FINAL_ANNEALING = (2.0, 1.0)
STEPS = 2
# A step that gains less ends a stage: the next stage moves everything anyway.
TOLERANCE = 0.02


def first_samples(objective: LeastSquaresProblem) -> int:
    """Return how many samples make the first window."""
    return min(len(objective.recorded), SAMPLES)


def fit_first_window(objective: LeastSquaresProblem, trace_std: Tensor) -> FitResult:
    """Fit the start alone to the first samples, from coarse to fine (docs/method.md#first-window).

    Args:
        objective: F over the whole record.
        trace_std: std of each sensor's trace, ``(sensor,)``.
    """
    window = objective.subset([]).truncate(first_samples(objective))
    noise = window.noise
    ratio = float((noise.std / trace_std.clamp(min=1e-300)).median())
    rough = [a for a in ANNEALING if a > FINAL_ANNEALING[0] * ratio]
    coarse = [replace(noise, std=torch.maximum(a * trace_std, noise.std)) for a in rough]
    fine = [noise.scaled(a) for a in FINAL_ANNEALING]
    phi = torch.zeros(objective.modes, dtype=torch.float64)
    for annealed in (*coarse, *fine):
        fitted = minimise(replace(window, noise=annealed), phi, STEPS, TOLERANCE)
        phi = fitted.phi
    return fitted
