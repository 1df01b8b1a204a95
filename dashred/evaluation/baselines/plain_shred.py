"""SHRED trained on plain simulations, without random discrepancies."""

from __future__ import annotations

from dashred.core.mlflow.tracker import Tracker
from dashred.evaluation.baselines.estimate import Estimate
from dashred.models.shred import reconstruct
from dashred.physics.runs.ensemble import Ensemble
from dashred.pipeline.networks.assimilation import sensor_data
from dashred.pipeline.networks.training import train_shred
from dashred.pipeline.problem import Problem


def plain_shred(problem: Problem, ensemble: Ensemble, run: Tracker) -> Estimate:
    """Return the field that SHRED reconstructs from the recording.

    Args:
        problem: the recording.
        ensemble: plain simulations over the fit window.
        run: MLflow run for the log.
    """
    learned = train_shred(problem, ensemble, run, {}, "plain SHRED")
    windows = sensor_data(problem).windows
    states = reconstruct(learned.shred.encode, learned.shred, windows)
    return Estimate(states, None, f"{len(ensemble.states)} members")
