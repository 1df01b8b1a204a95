"""Seeds of the start: each fitted to the first samples, and compared on validation sensors."""

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
from dashred.inference.forward.candidate_simulator import Simulator
from dashred.inference.forward.episodes import operator_of, side_by_side, starts_of
from dashred.inference.initial_state.first_guesses import (
    FirstGuessSettings,
    NetworkEstimate,
    Readings,
    first_guesses,
)
from dashred.inference.initial_state.start_models import StartModel
from dashred.physics.library import resolve
from dashred.physics.runs.ensemble import Ensemble
from dashred.pipeline.assimilation import Assimilated
from dashred.pipeline.discovery.objectives import (
    build_least_squares,
    for_each_episode,
    noise_share,
    trace_std,
)
from dashred.pipeline.problem import Problem
from dashred.pipeline.simulation import Nominal
from dashred.pipeline.training import Learned

# A seed goes before the prior where the prior's error is this many times as large: what a simulator
# leaves out is in the errors of all, and a front at another phase is far more than that. Where it
# is less than such a share of a trace's std the prior has found its way, however little the noise.
ELSEWHERE, NEAR = 3.0, 0.1


@dataclass(frozen=True)
class FittedGuess:
    """A seed that was fitted to the first window.

    Attributes:
        name: of the seed.
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
    learned: Learned,
    found: Assimilated,
    report: Report,
) -> list[FittedGuess]:
    """Fit every seed to the first window and return them, the best on validation first."""
    error = torch.tensor([learned.test_rmse[f] for f in problem.system.fields]) * learned.scale
    states = (found.dashred[0], *(dashred[0] for _, dashred in found.others))
    made = [
        _made(episode, nominal, ensemble, NetworkEstimate(state, error))
        for episode, state in zip(problem.episodes, states, strict=True)
    ]
    models = {"prior": nominal.start} | {
        name: starts_of([seeds[name] for seeds in made])
        for name in made[0]
        if name != "prior" and all(name in seeds for seeds in made)
    }
    fitted = []
    for i, (name, model) in enumerate(models.items(), start=1):
        fitted.append(fit_first_guess(problem, simulator, name, model))
        report(i / len(models), f"{name} {fitted[-1].error:.2f} σ")
    return ranked(fitted, NEAR * float((1 / noise_share(problem)).median()))


def _made(
    episode: Problem, nominal: Nominal, ensemble: Ensemble, network: NetworkEstimate
) -> dict[str, StartModel]:
    """Return the seeds of one episode by name."""
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


def ranked(seeds: Sequence[FittedGuess], near: float) -> list[FittedGuess]:
    """Return the best on validation first; the prior, unless others are far better.

    Of all seeds the prior alone uses no data twice, and laws are weighed about it in the end.

    Args:
        seeds: in any order.
        near: error of a prior that has found its way, in σ.
    """
    ordered = sorted(seeds, key=lambda seed: seed.error)
    bound = max(ELSEWHERE * ordered[0].error, near)
    return sorted(ordered, key=lambda seed: not (seed.name == "prior" and seed.error <= bound))


def fit_first_guess(
    problem: Problem, simulator: Simulator, name: str, model: StartModel
) -> FittedGuess:
    """Fit one seed to the first window and validate it there."""
    objective = build_least_squares(problem, simulator, model, [], 1.0)
    fitted = fit_first_window(objective, trace_std(problem))
    errors = [_rmse(problem, objective, fitted.phi, part) for part in _judges(problem)]
    return FittedGuess(name, model, fitted.phi, max(errors))


def _judges(problem: Problem) -> list[list[Recording]]:
    """Return what judges a seed: recordings of some sensors in every episode."""
    splits = [episode.split for episode in problem.episodes]
    fitted = [split.fit for split in splits]
    return [fitted, [split.validation for split in splits]] if splits[0].validate else [fitted]


def _rmse(
    problem: Problem, objective: LeastSquaresProblem, z: Tensor, judges: list[Recording]
) -> float:
    """Return the RMSE in σ over the first window, infinite for none."""
    samples = first_samples(objective)
    operator = operator_of(problem.operator(judges[0]), len(judges))
    forward_model = replace(objective.forward_model.until(samples), operator=operator)
    [readings] = forward_model.readings(z[None], z.new_zeros((1, 0)))
    recorded = side_by_side([torch.from_numpy(part.values[:samples]) for part in judges])
    recorded = recorded[: len(readings)]
    noise = for_each_episode(problem, problem.noise_of(judges[0].names))
    seen = ~torch.isnan(recorded)
    # Where a run blows up, nothing is missing: the seed is lost.
    scaled = ((readings - recorded) / noise)[seen]
    rmse = float(scaled.square().mean().sqrt()) if len(scaled) else math.inf
    return rmse if math.isfinite(rmse) else math.inf
