"""Follow a cause from the first part of a record to its end."""

from __future__ import annotations

from torch import Tensor

from dashred.core.progress import Report
from dashred.inference.fit.least_squares import LeastSquaresProblem
from dashred.inference.fit.levenberg_marquardt import FitResult, growing_horizon_fits, minimise
from dashred.inference.hypotheses.first_part import explains, follows

# Growth factor of the horizon, and the fit at each.
GROWTH, STEPS, TOLERANCE = 1.5, 4, 0.01


def follow_to_end(
    problem: LeastSquaresProblem, phi: Tensor, samples: int, name: str, report: Report
) -> FitResult | None:
    """Return the fit to the whole record; None as soon as a fit leaves more than noise.

    Args:
        problem: F of the cause over the whole record.
        phi: its fit to the first part.
        samples: number of samples of that part.
        name: of the cause, for the progress.
        report: progress.

    Raises:
        OutOfTimeError: the deadline of F is over.
    """
    total = len(problem.recorded)
    last = minimise(problem.truncate(samples), phi, STEPS, TOLERANCE)
    for longer in growing_horizon_fits(problem, last.phi, samples, GROWTH, STEPS):
        horizon = len(longer.readings)
        if not follows(problem.truncate(horizon), longer.chi2):
            return None
        report(horizon / total, f"{name} over {horizon} of {total} samples")
        last = longer
    return last if explains(problem, last.chi2) else None
