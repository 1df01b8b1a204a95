"""Fit the start of an episode that is held out as a whole, for a given law."""

from __future__ import annotations

import torch
from torch import Tensor

from dashred.inference.fit.first_window import fit_first_window
from dashred.inference.fit.law import Law
from dashred.inference.fit.least_squares import LeastSquaresProblem
from dashred.inference.fit.levenberg_marquardt import minimise
from dashred.inference.fit.noise_model import NoiseModel
from dashred.inference.forward.candidate_simulator import CandidateSimulator
from dashred.inference.forward.episodes import EpisodeStarts, stack_times
from dashred.inference.forward.forward_model import ForwardModel
from dashred.inference.forward.law_block import LawBlock
from dashred.inference.forward.sensor_block import SensorBlock
from dashred.inference.forward.simulator import Simulator
from dashred.inference.initial_state.start_models import StartModel
from dashred.inference.results.corrected_system import build_corrected_system
from dashred.pipeline.discovery.least_squares import noise_of_sound_sensors, trace_std
from dashred.pipeline.problem import Problem

STEPS, TOLERANCE = 30, 1e-8


@torch.no_grad()
def fit_starts(
    episode: Problem, prior: StartModel, law: Law, nothing: Law
) -> tuple[Tensor, Tensor]:
    """Return the fitted starts, ``(field, *grid)``, with the law and without it.

    Args:
        episode: held-out episode; only the fit part of its split is used, which is its beginning.
        prior: prior of the start.
        law: law that was fitted to the other episodes.
        nothing: the empty law, with the uncertain parameters that were fitted to them.
    """
    noise = noise_of_sound_sensors(episode, law)
    with_law, without = (_fit_start(episode, prior, noise, each) for each in (law, nothing))
    return with_law, without


def _fit_start(episode: Problem, prior: StartModel, noise: NoiseModel, law: Law) -> Tensor:
    fit, system = episode.split.fit, build_corrected_system(episode.system, law)
    forward_model = ForwardModel(
        Simulator([CandidateSimulator(system, system.dt, [])]),
        EpisodeStarts((prior,)),
        LawBlock([]),
        SensorBlock(episode.operator(fit)),
        stack_times([episode.times[: len(fit.times)]]),
    )
    none = torch.zeros(0, dtype=torch.float64)
    recorded = torch.from_numpy(fit.values)
    objective = LeastSquaresProblem(forward_model, recorded, noise, none)
    initial = fit_first_window(objective, trace_std(episode)).phi
    z = minimise(objective, initial, STEPS, TOLERANCE).phi
    return prior.start(z[None])[0]
