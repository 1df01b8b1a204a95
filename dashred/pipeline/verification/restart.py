"""Forecasts of the held-out time from a state fitted to the last samples before it."""

from __future__ import annotations

from dataclasses import replace

import torch
from torch import Tensor

from dashred.inference.fit.law import Law
from dashred.inference.fit.least_squares import LeastSquaresProblem
from dashred.inference.fit.levenberg_marquardt import minimise
from dashred.inference.forward.candidate_simulator import CandidateSimulator
from dashred.inference.forward.episodes import EpisodeStarts, stack_times
from dashred.inference.forward.forward_model import ForwardModel
from dashred.inference.forward.law_block import LawBlock
from dashred.inference.forward.sensor_block import SensorBlock
from dashred.inference.forward.simulator import Simulator
from dashred.inference.initial_state.start_models import LinearStart
from dashred.inference.results.corrected_system import build_corrected_system
from dashred.pipeline.discovery.least_squares import noise_of_sound_sensors
from dashred.pipeline.problem import Problem

# Samples to which a state is fitted: two seconds of a pendulum at 20 Hz.
FIT_SAMPLES = 40
STEPS, TOLERANCE = 30, 1e-8


@torch.no_grad()
def restart(problem: Problem, law: Law, corrected: Tensor) -> dict[str, Tensor]:
    """Return free runs over the held-out time, by method, ``(time, field)``.

    The simulator runs without and with the law, each from the state that best fits the last samples
    of the fit window. Empty for fields in space, which so few samples do not determine.

    Args:
        problem: the recording.
        law: the law.
        corrected: free run of the corrected simulator over the fit window, ``(time, field)``; its
            last part is the prior mean of the state, and its std the prior std.
    """
    if problem.system.axes or len(problem.times) == len(corrected):
        return {}
    first = max(0, len(corrected) - FIT_SAMPLES)
    fit = problem.split.fit
    values = torch.from_numpy(fit.values[first:])
    noise = noise_of_sound_sensors(problem, law)
    noise = replace(noise, available=noise.available[first:])
    start = EpisodeStarts((LinearStart(corrected[first], torch.diag(corrected.std(dim=0))),))
    times, count = stack_times([problem.times[first:]]), len(values)
    sensors = SensorBlock(problem.operator(fit))
    runs = {}
    for method, system in (
        ("simulation_refit", problem.system),
        ("corrected", build_corrected_system(problem.system, law)),
    ):
        simulator = Simulator([CandidateSimulator(system, system.dt, [])])
        forward_model = ForwardModel(simulator, start, LawBlock([]), sensors, times[:count])
        objective = LeastSquaresProblem(
            forward_model, values, noise, torch.zeros(0, dtype=torch.float64)
        )
        begin = torch.zeros(start.size, dtype=torch.float64)
        z = minimise(objective, begin, STEPS, TOLERANCE).phi[None]
        runs[method] = replace(forward_model, times=times).states(z, z[:, :0])[0, count:, 0]
    return runs
