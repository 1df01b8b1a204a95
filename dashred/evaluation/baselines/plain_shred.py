"""SHRED as it is usually trained: on simulations of the simulator as it is, none randomised."""

from __future__ import annotations

from dashred.core.mlflow.tracker import Tracker
from dashred.evaluation.baselines.estimate import Estimated
from dashred.models.shred import reconstruct
from dashred.physics.runs.ensemble import Ensemble
from dashred.pipeline.assimilation import sensor_data
from dashred.pipeline.problem import Problem
from dashred.pipeline.training import train_shred


def plain_shred(problem: Problem, ensemble: Ensemble, run: Tracker) -> Estimated:
    """Return what it reads from the recording.

    Args:
        problem: the recording.
        ensemble: plain simulations over the fit window.
        run: to log to.
    """
    learned = train_shred(problem, ensemble, run, {}, "plain SHRED")
    windows = sensor_data(problem).windows
    states = reconstruct(learned.shred.encode, learned.shred, windows)
    return Estimated(states, None, f"{len(ensemble.states)} members")
