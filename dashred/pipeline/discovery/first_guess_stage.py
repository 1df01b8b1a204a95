"""First guesses of the start: fitted to the first samples, compared on validation sensors."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import torch
from torch import Tensor

from dashred.core.progress import Report
from dashred.data.recording import Recording
from dashred.inference.fit.first_window import first_samples, fit_first_window
from dashred.inference.fit.least_squares import LeastSquaresProblem
from dashred.inference.forward.episodes import EpisodeStarts, stack_readings
from dashred.inference.forward.sensor_block import SensorBlock
from dashred.inference.forward.simulator import Simulator
from dashred.inference.initial_state.first_guesses import (
    FirstGuessSettings,
    NetworkEstimate,
    Readings,
    first_guesses,
)
from dashred.inference.initial_state.start_models import StartModel
from dashred.physics.library import resolve
from dashred.physics.runs.ensemble import Ensemble
from dashred.pipeline.assimilation import AssimilationResult
from dashred.pipeline.discovery.objectives import (
    build_least_squares,
    for_each_episode,
    noise_share,
    trace_std,
)
from dashred.pipeline.problem import Problem
from dashred.pipeline.simulation import Nominal
from dashred.pipeline.training import TrainedNetwork

# A first guess goes before the prior where the prior's error is this many times as large: what a
# simulator leaves out is in the errors of all, and a front at another phase is far more than that.
# Where it is less than such a share of a trace's std the prior has found its way, however little
# the noise.
ELSEWHERE, NEAR = 3.0, 0.1


@dataclass(frozen=True)
class FittedGuess:
    """A first guess of the start that was fitted to the first window.

    Attributes:
        name: of the first guess.
        start: u₀(z).
        z: its fit, ``(mode,)``.
        error: RMSE in σ over the first window, on the validation sensors or on the fit sensors,
            whichever is worse: what cannot be fitted, a few quiet sensors may not notice.
    """

    name: str
    start: StartModel
    z: Tensor
    error: float


def fit_first_guesses(
    problem: Problem,
    simulator: Simulator,
    nominal: Nominal,
    ensemble: Ensemble,
    learned: TrainedNetwork,
    found: AssimilationResult,
    report: Report,
) -> list[FittedGuess]:
    """Fit every first guess to the first window; return the best on validation first."""
    error = torch.tensor([learned.test_rmse[f] for f in problem.system.fields]) * learned.scale
    states = (found.dashred[0], *(dashred[0] for _, dashred in found.others))
    made = [
        _made(episode, nominal, ensemble, NetworkEstimate(state, error))
        for episode, state in zip(problem.episodes, states, strict=True)
    ]
    models: dict[str, StartModel] = {"prior": nominal.start} | {
        name: EpisodeStarts(tuple(guesses[name] for guesses in made))
        for name in made[0]
        if name != "prior" and all(name in guesses for guesses in made)
    }
    fitted = []
    for i, (name, model) in enumerate(models.items(), start=1):
        fitted.append(fit_first_guess(problem, simulator, name, model))
        report(i / len(models), f"{name} {fitted[-1].error:.2f} σ")
    return ranked(fitted, NEAR * float((1 / noise_share(problem)).median()))


def _made(
    episode: Problem, nominal: Nominal, ensemble: Ensemble, network: NetworkEstimate
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
    )


def ranked(guesses: Sequence[FittedGuess], near: float) -> list[FittedGuess]:
    """Return the best on validation first; the prior, unless others are far better.

    The prior alone uses no data twice, and laws are weighed about it in the end.

    Args:
        guesses: in any order.
        near: error of a prior that has found its way, in σ.
    """
    ordered = sorted(guesses, key=lambda guess: guess.error)
    bound = max(ELSEWHERE * ordered[0].error, near)
    return sorted(ordered, key=lambda guess: not (guess.name == "prior" and guess.error <= bound))


def fit_first_guess(
    problem: Problem, simulator: Simulator, name: str, model: StartModel
) -> FittedGuess:
    """Fit one first guess to the first window and validate it there."""
    objective = build_least_squares(problem, simulator, model, [], 1.0)
    fitted = fit_first_window(objective, trace_std(problem))
    errors = [_rmse(problem, objective, fitted.phi, part) for part in _judges(problem)]
    return FittedGuess(name, model, fitted.phi, max(errors))


def _judges(problem: Problem) -> list[list[Recording]]:
    """Return what judges a first guess: recordings of some sensors in every episode."""
    splits = [episode.split for episode in problem.episodes]
    fitted = [split.fit for split in splits]
    return [fitted, [split.validation for split in splits]] if splits[0].validate else [fitted]


def _rmse(
    problem: Problem, objective: LeastSquaresProblem, z: Tensor, judges: list[Recording]
) -> float:
    """Return the RMSE in σ over the first window, infinite for none."""
    samples = first_samples(objective)
    sensors = SensorBlock(problem.operator(judges[0]), len(judges))
    forward_model = replace(objective.forward_model.until(samples), sensors=sensors)
    [readings] = forward_model.readings(z[None], z.new_zeros((1, 0)))
    recorded = stack_readings([torch.from_numpy(part.values[:samples]) for part in judges])
    recorded = recorded[: len(readings)]
    noise = for_each_episode(problem, problem.noise_of(judges[0].names))
    seen = ~torch.isnan(recorded)
    # Where a run blows up, nothing is missing: the guess is lost.
    scaled = ((readings - recorded) / noise)[seen]
    rmse = float(scaled.square().mean().sqrt()) if len(scaled) else math.inf
    return rmse if math.isfinite(rmse) else math.inf
