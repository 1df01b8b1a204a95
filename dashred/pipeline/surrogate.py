"""The corrected surrogate: SHRED retrained on the corrected simulator.

See docs/method.md#corrected-surrogate.
"""

from __future__ import annotations

from torch import Tensor

from dashred.core.mlflow.run import MlflowRun
from dashred.core.progress import stage
from dashred.core.tracking import RunTracker
from dashred.inference.fit.law import Law
from dashred.models.latency import seconds_per_step
from dashred.models.shred import reconstruct
from dashred.models.surrogate_model import log_surrogate
from dashred.physics.runs.initial_state_prior import StartPrior
from dashred.physics.system import System
from dashred.pipeline.corrected_ensemble import simulate_corrected
from dashred.pipeline.networks.assimilation import sensor_data
from dashred.pipeline.networks.training import TrainedNetwork, train_shred
from dashred.pipeline.problem import Problem
from dashred.pipeline.simulation.ensembles import join_ensembles
from dashred.pipeline.simulation.nominal_run import NominalRun
from dashred.pipeline.trajectories import Trajectories

# Key in run.json of the time that one step of the corrected surrogate takes.
STEP = "one step of the corrected SHRED"


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
    prior, settings = nominal.prior, problem.config.surrogate

    def near_the_fit(system: System, index: int) -> StartPrior:
        return StartPrior(system, law.start[index], prior.rms, prior.kept)

    drawn = simulate_corrected(
        problem,
        law,
        free,
        near_the_fit,
        settings.spread,
        settings.members,
        "corrected ensemble",
        seconds,
    )
    if drawn is not None:
        ensemble = join_ensembles([each.ensemble for each in drawn])
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
