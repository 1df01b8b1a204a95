"""Fit the start to the first samples, with noise annealed from coarse to fine."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import replace

import torch
from torch import Tensor

from dashred.core.budget import OutOfTimeError
from dashred.inference.fit.least_squares import LeastSquaresProblem
from dashred.inference.fit.levenberg_marquardt import FitResult, minimise

# A longer stretch has many false minima, if a front is slightly displaced or the system is chaotic.
# The prior determines what so few readings do not, until the horizon grows.
SAMPLES = 6
# Values of σ: first in units of the std of the traces, then in units of the noise.
ANNEALING = (1.0, 0.3, 0.1, 0.03)
FINAL_ANNEALING = (2.0, 1.0)
STEPS = 2
# A stage ends at a step that lowers F by a smaller share.
TOLERANCE = 0.02


def first_samples(objective: LeastSquaresProblem) -> int:
    """Return the number of samples of the first window."""
    return min(len(objective.recorded), SAMPLES)


def fit_first_window(objective: LeastSquaresProblem, trace_std: Tensor) -> FitResult:
    """Fit the start to the first samples (docs/method.md#first-window).

    At the deadline of F the fit ends with the best start so far.

    Args:
        objective: F over the whole record.
        trace_std: std of the trace of each sensor, ``(sensor,)``.
    """
    window = objective.subset([]).truncate(first_samples(objective))
    noise = window.noise
    ratio = float((noise.std / trace_std.clamp(min=1e-300)).median())
    rough = [a for a in ANNEALING if a > FINAL_ANNEALING[0] * ratio]
    coarse = [replace(noise, std=torch.maximum(a * trace_std, noise.std)) for a in rough]
    fine = [noise.scaled(a) for a in FINAL_ANNEALING]
    start = torch.zeros(objective.modes, dtype=torch.float64)
    fitted = minimise(window, start, 0, TOLERANCE)
    with suppress(OutOfTimeError):
        for annealed in (*coarse, *fine):
            fitted = minimise(replace(window, noise=annealed), fitted.phi, STEPS, TOLERANCE)
    return fitted
