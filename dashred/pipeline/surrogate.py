"""The corrected surrogate: SHRED retrained on the corrected simulator.

See docs/method.md#corrected-surrogate.
"""

from __future__ import annotations

from contextlib import suppress

import numpy as np
import torch
from torch import Tensor

from dashred.core.errors import InputError
from dashred.core.mlflow.run import MlflowRun
from dashred.core.progress import Report, stage
from dashred.core.tracking import RunTracker
from dashred.inference.fit.law import Law
from dashred.inference.initial_state.start_models import ScaledStart
from dashred.inference.results.corrected_system import correct
from dashred.models.latency import seconds_per_step
from dashred.models.shred import reconstruct
from dashred.models.surrogate_model import log_surrogate
from dashred.physics.runs.ensemble import Ensemble, draw_ensemble
from dashred.physics.runs.initial_state_prior import StartPrior
from dashred.physics.solvers.simulate import simulate
from dashred.physics.system import System
from dashred.pipeline.assimilation import sensor_data
from dashred.pipeline.problem import Problem
from dashred.pipeline.simulation import Nominal, shares, together
from dashred.pipeline.training import TrainedNetwork, train_shred
from dashred.pipeline.trajectories import Trajectories

# What run.json calls the seconds of one step of the corrected surrogate.
STEP = "one step of the corrected SHRED"
# How much nearer to the start than the settings say members are drawn, where need be.
NARROWER, LEAST = (1.0, 0.3), 0.1


def retrain(
    problem: Problem,
    nominal: Nominal,
    law: Law,
    free: Trajectories,
    learned: TrainedNetwork,
    run: RunTracker,
    seconds: dict[str, float],
) -> tuple[TrainedNetwork, list[Tensor]]:
    """Train SHRED on the corrected simulator and read the recording with it.

    The members start about the fitted start, nearer to it than the prior's are to theirs: the
    surrogate is for this system, whose state is now known far better.

    Args:
        problem: the simulator and the recording.
        nominal: gives the prior's rms.
        law: the correction.
        free: gives the corrected trajectory, for ranges.
        learned: the network to begin from; it has read many laws already.
        run: to log to.
        seconds: to note the time in.

    Returns:
        The network, and the field that it reads, ``(time, field, *grid)``, over the fit window of
        every episode.
    """
    settings = problem.config.surrogate
    prior, starts = nominal.prior, law.start
    corrected = [free, *free.others]
    with torch.no_grad(), stage("simulate the corrected", seconds) as report:
        drawn = []
        for i, (episode, times, members, suffix) in enumerate(shares(problem, settings.members)):
            system = _stepped(episode, law, starts[i], times)
            path = corrected[i].states["corrected"][: len(episode.split.fit.times)]
            rng = problem.rng(f"corrected ensemble{suffix}")
            about = StartPrior(system, starts[i], prior.rms, prior.kept)
            drawn.append(
                _members(system, times, about, settings.spread, path, members, rng, report)
            )
        ensemble = together(drawn)
        report(1.0, f"{settings.members} members")
    found = train_shred(problem, ensemble, run, seconds, "corrected SHRED", learned.shred)
    windows = sensor_data(problem).windows
    step = seconds_per_step(found.shred, windows[-1])
    run.log_metrics({"surrogate/milliseconds": 1e3 * step}, 0)
    seconds[STEP] = step
    counts = [len(episode.split.fit.times) for episode in problem.episodes]
    read = reconstruct(found.shred.encode, found.shred, windows)
    return found, list(read.split(counts))


def log_model(
    problem: Problem, network: TrainedNetwork, run: MlflowRun, seconds: dict[str, float]
) -> str:
    """Log the network as an MLflow model; returns its URI."""
    with stage("log the surrogate", seconds) as report:
        windows = sensor_data(problem).windows
        uri = log_surrogate(run, network.shred, windows, list(problem.split.inputs))
        run.set_tags({"surrogate": uri})
        report(1.0, uri)
    return uri


def _stepped(episode: Problem, law: Law, start: Tensor, times: Tensor) -> System:
    """Return the corrected simulator with the ensemble's step, or its own where that blows up."""
    quick = correct(episode.ensemble_system, law)
    stable = bool(torch.isfinite(simulate(quick, start[None], times)).all())
    return quick if stable else correct(episode.system, law)


def _members(
    system: System,
    times: Tensor,
    about: StartPrior,
    spread: float,
    path: Tensor,
    members: int,
    rng: np.random.Generator,
    report: Report,
) -> Ensemble:
    """Draw members about a start: nearer to it, where hardly any keeps to the law's own range."""

    def draw(share: float) -> Ensemble:
        starts = ScaledStart(about, share * spread)
        return draw_ensemble(
            system, times, starts, path, members, None, rng, lambda done: report(done, "")
        )

    for share in NARROWER:
        with suppress(InputError):
            return draw(share)
    return draw(LEAST)
