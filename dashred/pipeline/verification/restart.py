"""Forecasts from a fresh state: fitted to the last samples before the held-out time alone."""

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
from dashred.inference.results.corrected_system import correct
from dashred.pipeline.discovery.objectives import sound_noise
from dashred.pipeline.problem import Problem

# Samples that a state is fitted to: two seconds of a pendulum's twenty a second.
SAMPLES = 40
STEPS, TOLERANCE = 30, 1e-8


@torch.no_grad()
def restart(problem: Problem, law: Law, corrected: Tensor) -> dict[str, Tensor]:
    """Return free runs over the held-out time, by method, ``(time, field)``.

    The simulator without the law and with it, each from the state that fits best the last samples
    of the fit window. For ODE systems alone: of a whole field so few samples say too little.

    Args:
        problem: the recording.
        law: what the simulator leaves out.
        corrected: the corrected simulator's free run over the fit window, ``(time, field)``; the
            state is looked for about its last part, within its own spread.
    """
    if problem.system.axes or len(problem.times) == len(corrected):
        return {}
    first = max(0, len(corrected) - SAMPLES)
    fit = problem.split.fit
    values = torch.from_numpy(fit.values[first:])
    noise = sound_noise(problem, law)
    noise = replace(noise, seen=noise.seen[first:])
    start = EpisodeStarts((LinearStart(corrected[first], torch.diag(corrected.std(dim=0))),))
    times, count = stack_times([problem.times[first:]]), len(values)
    sensors = SensorBlock(problem.operator(fit))
    runs = {}
    for method, system in (
        ("simulation_refit", problem.system),
        ("corrected", correct(problem.system, law)),
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
