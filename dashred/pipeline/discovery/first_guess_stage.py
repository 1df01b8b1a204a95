"""Fit first guesses of the start to the first samples and rank them on the validation sensors."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import torch
from torch import Tensor

from dashred.core.budget import NEVER, Deadline
from dashred.core.progress import Report
from dashred.data.recording import Recording
from dashred.inference.fit.first_window import first_samples, fit_first_window
from dashred.inference.fit.least_squares import LeastSquaresProblem
from dashred.inference.forward.episodes import EpisodeStarts, stack_readings
from dashred.inference.forward.read_parameters import read_parameters
from dashred.inference.forward.sensor_block import SensorBlock
from dashred.inference.forward.simulator import Simulator
from dashred.inference.initial_state.first_guesses import (
    FirstGuessSettings,
    NetworkEstimate,
    Readings,
    first_guesses,
)
from dashred.inference.initial_state.start_models import StartModel
from dashred.physics.runs.ensemble import Ensemble
from dashred.physics.terms.library import resolve
from dashred.pipeline.discovery.least_squares import (
    build_least_squares,
    for_each_episode,
    noise_share,
    trace_std,
)
from dashred.pipeline.networks.assimilation import AssimilationResult
from dashred.pipeline.networks.training import TrainedNetwork
from dashred.pipeline.problem import Problem
from dashred.pipeline.simulation.nominal_run import NominalRun

# The prior is used first unless its error is this many times the smallest error. The missing
# physics contributes to the errors of all first guesses. A wrong start, such as a front at another
# phase, has a much larger error.
PRIOR_MARGIN = 3.0
# The prior is used first if its error is below this share of the std of a trace, even if the noise
# is much smaller.
SMALL_ERROR = 0.1


@dataclass(frozen=True)
class FittedGuess:
    """A first guess of the start that was fitted to the first window.

    Attributes:
        name: name of the first guess.
        start: start as a function u₀(z) of its parameters.
        z: fitted parameters, ``(mode,)``.
        error: RMSE in σ over the first window, on the fit or the validation sensors, whichever is
            larger. A few validation sensors alone may miss a misfit.
    """

    name: str
    start: StartModel
    z: Tensor
    error: float


def fit_first_guesses(
    problem: Problem,
    simulator: Simulator,
    nominal: NominalRun,
    ensemble: Ensemble,
    network: TrainedNetwork,
    assimilated: AssimilationResult,
    report: Report,
) -> list[FittedGuess]:
    """Fit every first guess to the first window and return them, the preferred one first."""
    error = torch.tensor([network.test_rmse[f] for f in problem.system.fields]) * network.scale
    states = (assimilated.dashred[0], *(dashred[0] for _, dashred in assimilated.others))
    deadline = problem.deadline("fit the first guesses")
    by_episode = [
        _guesses_of_episode(episode, nominal, ensemble, NetworkEstimate(state, error), deadline)
        for episode, state in zip(problem.episodes, states, strict=True)
    ]
    models: dict[str, StartModel] = {"prior": nominal.start} | {
        name: EpisodeStarts(tuple(guesses[name] for guesses in by_episode))
        for name in by_episode[0]
        if name != "prior" and all(name in guesses for guesses in by_episode)
    }
    fitted: list[FittedGuess] = []
    for i, (name, model) in enumerate(models.items(), start=1):
        if fitted and deadline.is_over:
            break
        fitted.append(fit_first_guess(problem, simulator, name, model, deadline))
        report(i / len(models), f"{name} {fitted[-1].error:.2f} σ")
    if deadline.is_over:
        problem.budget.leave_out("further first guesses")
    return rank_guesses(fitted, SMALL_ERROR * float((1 / noise_share(problem)).median()))


def _guesses_of_episode(
    episode: Problem,
    nominal: NominalRun,
    ensemble: Ensemble,
    network: NetworkEstimate,
    deadline: Deadline,
) -> dict[str, StartModel]:
    """Return the first guesses of one episode by name."""
    fit = episode.split.fit
    readings = Readings(
        episode.times[: len(fit.times)],
        torch.from_numpy(fit.values),
        episode.operator(fit),
        episode.noise_of(fit.names),
    )
    return first_guesses(
        episode.ensemble_system,
        nominal.prior,
        ensemble,
        resolve(episode.system, episode.library),
        readings,
        network,
        FirstGuessSettings(),
        deadline,
    )


def rank_guesses(guesses: Sequence[FittedGuess], near: float) -> list[FittedGuess]:
    """Sort first guesses by their error, with the prior first unless another is much better.

    The prior is preferred because it uses no data twice and because the final laws are compared
    with it.

    Args:
        guesses: fitted first guesses in any order.
        near: error in σ below which the prior is always first.
    """
    ordered = sorted(guesses, key=lambda guess: guess.error)
    bound = max(PRIOR_MARGIN * ordered[0].error, near)
    return sorted(ordered, key=lambda guess: not (guess.name == "prior" and guess.error <= bound))


def fit_first_guess(
    problem: Problem,
    simulator: Simulator,
    name: str,
    model: StartModel,
    deadline: Deadline = NEVER,
) -> FittedGuess:
    """Fit one first guess to the first window and compute its error there."""
    objective = build_least_squares(problem, simulator, model, [], 1.0)
    objective = replace(objective, deadline=deadline)
    fitted = fit_first_window(objective, trace_std(problem))
    errors = [_rmse(problem, objective, fitted.phi, part) for part in _recordings(problem)]
    return FittedGuess(name, model, fitted.phi, max(errors))


def _recordings(problem: Problem) -> list[list[Recording]]:
    """Return the recordings of the fit and of the validation sensors, each by episode."""
    splits = [episode.split for episode in problem.episodes]
    fitted = [split.fit for split in splits]
    return [fitted, [split.validation for split in splits]] if splits[0].validate else [fitted]


def _rmse(
    problem: Problem, objective: LeastSquaresProblem, z: Tensor, recordings: list[Recording]
) -> float:
    """Return the RMSE in σ over the first window; infinite if the run blows up."""
    samples = first_samples(objective)
    systems = [episode.system for episode in problem.episodes]
    read = read_parameters(recordings[0].sensors, systems)
    sensors = SensorBlock(problem.operator(recordings[0]), len(recordings), parameters=read)
    forward_model = replace(objective.forward_model.truncate(samples), sensors=sensors)
    [readings] = forward_model.readings(z[None], z.new_zeros((1, 0)))
    recorded = stack_readings([torch.from_numpy(part.values[:samples]) for part in recordings])
    recorded = recorded[: len(readings)]
    noise = for_each_episode(problem, problem.noise_of(recordings[0].names))
    seen = ~torch.isnan(recorded)
    # A run that blows up gives an infinite error instead of missing values.
    scaled = ((readings - recorded) / noise)[seen]
    rmse = float(scaled.square().mean().sqrt()) if len(scaled) else math.inf
    return rmse if math.isfinite(rmse) else math.inf
