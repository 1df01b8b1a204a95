"""Scores and coefficients of the best law of each size, as MLflow shows them."""

from __future__ import annotations

from collections.abc import Iterable

from dashred.core.mlflow.metric_names import metric_name
from dashred.core.tracking import StageTracker
from dashred.inference.hypotheses.result import BestOfSize


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
