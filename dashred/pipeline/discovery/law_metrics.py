"""Metrics of the discovery in MLflow: first guesses, horizon, and the best law of each size."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence

from dashred.core.mlflow.metric_names import metric_name
from dashred.core.tracking import RunTracker, StageTracker
from dashred.inference.fit.growing_horizon import HorizonFit
from dashred.inference.hypotheses.result import BestOfSize
from dashred.pipeline.discovery.first_guess_stage import FittedGuess


def log_best_by_size(run: StageTracker, path: Iterable[BestOfSize]) -> None:
    """Log the best law of each size; the step of MLflow is its number of terms.

    Args:
        run: tracker of the child run of the discovery.
        path: the best laws.
    """
    for best in path:
        scores = {"evidence/score": best.score, "evidence/rmse": best.rmse}
        coefficients = {
            metric_name("coef", candidate.equation or "parameter", candidate.name): value
            for candidate, value in zip(best.candidates, best.coefficients, strict=True)
        }
        run.log_metrics(scores | coefficients, len(best.candidates))


def log_first_guesses(
    run: RunTracker,
    child: StageTracker,
    guesses: Sequence[FittedGuess],
    guess: FittedGuess,
    horizon: HorizonFit,
) -> None:
    """Log the errors of the first guesses, which of them was used, and the growing horizon."""
    child.log_metrics({f"seed/{g.name}": g.error for g in guesses if math.isfinite(g.error)}, 0)
    child.set_tags({"seed of the start": guess.name})
    for samples, level in horizon.levels:
        child.log_metrics({"horizon/chi2": level}, samples)
        run.log_metrics({"horizon/chi2": level}, samples)
