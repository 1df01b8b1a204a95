"""The corrected surrogate: SHRED retrained on the corrected simulator.

See docs/method.md#corrected-surrogate.
"""

from __future__ import annotations

from contextlib import suppress
from dataclasses import replace

import torch
from torch import Tensor

from dashred.core.errors import InputError
from dashred.core.mlflow.run import MlflowRun
from dashred.core.progress import stage
from dashred.core.tracking import RunTracker
from dashred.inference.fit.law import Law
from dashred.inference.initial_state.start_models import ScaledStart
from dashred.inference.results.corrected_system import build_corrected_system
from dashred.models.latency import seconds_per_step
from dashred.models.shred import reconstruct
from dashred.models.surrogate_model import log_surrogate
from dashred.physics.runs.ensemble import Ensemble, MemberSource
from dashred.physics.runs.initial_state_prior import StartPrior
from dashred.physics.solvers.simulate import simulate
from dashred.physics.system import System
from dashred.pipeline.networks.assimilation import sensor_data
from dashred.pipeline.networks.training import TrainedNetwork, train_shred
from dashred.pipeline.problem import Problem
from dashred.pipeline.simulation.ensemble_memory import Draw, drawing
from dashred.pipeline.simulation.ensembles import join_ensembles, split_members
from dashred.pipeline.simulation.nominal_run import NominalRun
from dashred.pipeline.simulation.program_cost import check_time
from dashred.pipeline.simulation.time_limit import within
from dashred.pipeline.trajectories import Trajectories

# Key in run.json of the time that one step of the corrected surrogate takes.
STEP = "one step of the corrected SHRED"
# Factors of the spread of the members that are tried in turn; the last is used in any case.
SPREAD_FACTORS, LAST_FACTOR = (1.0, 0.3), 0.1


def retrain(
    problem: Problem,
    nominal: NominalRun,
    law: Law,
    free: Trajectories,
    network: TrainedNetwork,
    run: RunTracker,
    seconds: dict[str, float],
) -> tuple[TrainedNetwork, list[Tensor]]:
    """Train SHRED on the corrected simulator and read the recording with it.

    The members start near the fitted start. Their spread is smaller than that of the prior,
    because the fit determines the state of this system much better.

    Args:
        problem: simulator and recording.
        nominal: simulation that gives the RMS of the fields for the prior.
        law: correction of the simulator.
        free: free runs; the corrected one limits the range of the members.
        network: network from which the training starts.
        run: tracker of the parent run.
        seconds: run time by stage, updated.

    Returns:
        The network, and the field that it reconstructs over the fit window of each episode,
        ``(time, field, *grid)``. If no member stays within bounds, the network is not trained.

    Raises:
        OutOfTimeError: there was no time for the members.
    """
    corrected_network = network
    ensemble = _corrected_ensemble(problem, nominal.prior, law, free, seconds)
    if ensemble is not None:
        corrected_network = train_shred(
            problem, ensemble, run, seconds, "corrected SHRED", network.shred
        )
    windows = sensor_data(problem).windows
    step = seconds_per_step(corrected_network.shred, windows[-1])
    run.log_metrics({"surrogate/milliseconds": 1e3 * step}, 0)
    seconds[STEP] = step
    counts = [len(episode.split.fit.times) for episode in problem.episodes]
    shred = corrected_network.shred
    return corrected_network, list(reconstruct(shred.encode, shred, windows).split(counts))


@torch.no_grad()
def _corrected_ensemble(
    problem: Problem, prior: StartPrior, law: Law, free: Trajectories, seconds: dict[str, float]
) -> Ensemble | None:
    """Return simulations of the corrected simulator; None if they do not stay within bounds."""
    settings, starts = problem.config.surrogate, law.start
    corrected = [free, *free.others]
    deadline = problem.deadline("corrected ensemble")
    check_time(problem, settings.members, "corrected ensemble")
    with stage("corrected ensemble", seconds) as report:
        progress = within(deadline, report)
        drawn = []
        for i, (episode, times, members, suffix) in enumerate(
            split_members(problem, settings.members)
        ):
            system = _ensemble_system(episode, law, starts[i], times, free.shortest_dt)
            path = corrected[i].states["corrected"][: len(episode.split.fit.times)]
            rng = problem.rng(f"corrected ensemble{suffix}")
            start_prior = StartPrior(system, starts[i], prior.rms, prior.kept)
            draw = drawing(problem, f"corrected ensemble {i}")
            try:
                source = MemberSource(system, times, start_prior, path, None, rng, progress)
                drawn.append(_members(draw, source, settings.spread, members))
            except InputError:
                report(1.0, "no member stays within bounds")
                return None
        report(1.0, f"{settings.members} members")
    return join_ensembles(drawn)


def log_model(
    problem: Problem, network: TrainedNetwork, run: MlflowRun, seconds: dict[str, float]
) -> str:
    """Log the network as an MLflow model and return its URI."""
    with stage("log the surrogate", seconds) as report:
        windows = sensor_data(problem).windows
        inputs = list(problem.split.inputs)
        uri = run.request(lambda: log_surrogate(run, network.shred, windows, inputs))
        run.set_tags({"surrogate": uri})
        report(1.0, uri)
    return uri


def _ensemble_system(
    episode: Problem, law: Law, start: Tensor, times: Tensor, dt: float | None
) -> System:
    """Return the corrected simulator, with the time step of the ensemble if that is stable.

    Args:
        episode: its recording and simulator.
        law: the correction.
        start: the fitted start, ``(field, *grid)``.
        times: output times.
        dt: the time step that the corrected simulator needs; None if that of the simulator is
            stable.
    """
    if dt is not None:
        return build_corrected_system(episode.system, law).with_step(dt)
    quick = build_corrected_system(episode.ensemble_system, law)
    stable = bool(torch.isfinite(simulate(quick, start[None], times)).all())
    return quick if stable else build_corrected_system(episode.system, law)


def _members(draw: Draw, source: MemberSource, spread: float, members: int) -> Ensemble:
    """Draw members around a start.

    If too few of them stay within the range of the corrected run, the spread is reduced.

    Args:
        draw: simulates them.
        source: with the prior of the start.
        spread: factor on the spread of the prior.
        members: number of trajectories.
    """

    def scaled(factor: float) -> Ensemble:
        starts = ScaledStart(source.prior, factor * spread)
        return draw(replace(source, prior=starts), members)

    for factor in SPREAD_FACTORS:
        with suppress(InputError):
            return scaled(factor)
    return scaled(LAST_FACTOR)
