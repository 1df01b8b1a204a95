"""Forecasts of the held-out time from a state fitted to the last samples before it."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import torch
from torch import Tensor

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
from dashred.inference.initial_state.start_models import LinearStart
from dashred.inference.results.corrected_system import build_corrected_system
from dashred.physics.system import System
from dashred.pipeline.discovery.least_squares import noise_of_sound_sensors
from dashred.pipeline.problem import Problem
from dashred.pipeline.simulation.reading_range import distance_from_readings
from dashred.pipeline.simulation.state_samples import FARTHEST
from dashred.pipeline.trajectories import UNPREDICTABLE_GROWTH

# Samples to which a state is fitted: two seconds of a pendulum at 20 Hz.
FIT_SAMPLES = 40
# But so many are fitted in any case, where forecasts are shorter than that.
FEWEST_FITTED = 4
STEPS, TOLERANCE = 30, 1e-8
# A forecast ends when a small error of its start has grown by this factor, and at most this many
# are made. Shorter forecasts than FEWEST_SAMPLES are not made.
FORECAST_GROWTH, MOST_FORECASTS, FEWEST_SAMPLES = 20.0, 8, 8


@torch.no_grad()
def restart(
    problem: Problem, law: Law, nothing: Law, corrected: Tensor, growth_rate: float = 0.0
) -> list[tuple[slice, dict[str, Tensor]]]:
    """Return forecasts of the held-out time from states that are fitted just before them.

    The simulator runs without and with the law, each from the state that best fits the samples just
    before the forecast. There is one forecast of the whole held-out time, or several of a few
    Lyapunov times each if the system is chaotic. Empty for fields in space, which so few samples do
    not determine.

    Args:
        problem: the recording.
        law: the law.
        nothing: the empty law, with the parameters that were fitted without a law.
        corrected: free run of the corrected simulator over the fit window, ``(time, field)``. The
            prior mean of the state is that state of the run whose readings are nearest, and the
            prior std is the std of the run.
        growth_rate: rate at which a small error of the start grows, in 1/time.

    Returns:
        The samples of the held-out time and the runs by method, ``(time, field)``.
    """
    first, last = len(corrected), len(problem.times)
    if problem.system.axes or first == last:
        return []
    fit = problem.split.fit
    late = problem.split.heldout.select(fit.names)
    values = torch.from_numpy(np.concatenate([fit.values, late.values]))
    noise = noise_of_sound_sensors(problem, law)
    sound = noise.available.any(dim=0)
    early_sizes, late_sizes = problem.relative_noise(fit), problem.relative_noise(late)
    relative = None
    if early_sizes is not None and late_sizes is not None:
        relative = torch.from_numpy(np.concatenate([early_sizes, late_sizes]))
    noise = replace(noise, available=~values.isnan() & sound, relative=relative)
    systems = {
        "simulation_refit": build_corrected_system(problem.system, nothing),
        "corrected": build_corrected_system(problem.system, law),
    }
    span = _forecast_samples(problem, last - first, growth_rate)
    forecasts = []
    for begin in range(first, last, span):
        end = min(begin + span, last)
        known = slice(max(0, begin - max(FEWEST_FITTED, min(FIT_SAMPLES, span))), begin)
        window = noise.part(known)
        start = _analog(problem, corrected, values[known], window)
        runs = {
            method: _forecast(problem, system, start, values[known], window, known.start, end)
            for method, system in systems.items()
        }
        forecasts.append((slice(begin - first, end - first), runs))
    return forecasts


def _forecast_samples(problem: Problem, samples: int, growth_rate: float) -> int:
    """Return the samples of a forecast: all, or fewer if the system is chaotic."""
    times = problem.times[-samples - 1 :]
    if growth_rate * float(problem.times[-1] - problem.times[0]) <= math.log(UNPREDICTABLE_GROWTH):
        return samples
    step = float(times[-1] - times[0]) / samples
    predictable = round(math.log(FORECAST_GROWTH) / growth_rate / step)
    return min(samples, max(predictable, FEWEST_SAMPLES, math.ceil(samples / MOST_FORECASTS)))


def _analog(problem: Problem, path: Tensor, values: Tensor, noise: NoiseModel) -> LinearStart:
    """Return the distribution of a state about that of a run whose readings are nearest.

    Args:
        problem: gives the sensors.
        path: states of the run, ``(time, field)``.
        values: readings from the state on, ``(time, sensor)``.
        noise: noise of these readings.
    """
    # The std of a run that has left the range of the recording says nothing about its states.
    near = distance_from_readings(problem, path) < FARTHEST
    finite = path[near if int(near.sum()) >= FEWEST_FITTED else path.isfinite().all(dim=1)]
    readings = problem.operator(problem.split.fit)(finite)
    length = min(len(values), len(readings))
    residuals = readings.unfold(0, length, 1).movedim(-1, 1) - values[:length]
    seen = noise.available[:length]
    stds = noise.part(slice(length)).stds
    misfits = torch.where(seen, residuals / stds, 0.0).square().sum(dim=(1, 2))
    return LinearStart(finite[int(misfits.argmin())], torch.diag(finite.std(dim=0, correction=0)))


def _forecast(
    problem: Problem,
    system: System,
    start: LinearStart,
    values: Tensor,
    noise: NoiseModel,
    first: int,
    end: int,
) -> Tensor:
    """Return a run after the fitted samples, ``(time, field)``.

    Args:
        problem: gives the sensors and the times.
        system: the simulator.
        start: distribution of the state at the first fitted sample.
        values: the fitted samples, ``(time, sensor)``.
        noise: their noise.
        first: index of the first fitted sample.
        end: index after the last sample of the forecast.
    """
    count = len(values)
    times = stack_times([problem.times[first:end]])
    simulator = Simulator([CandidateSimulator(system, system.dt, [])])
    sensors = SensorBlock(problem.operator(problem.split.fit))
    starts = EpisodeStarts((start,))
    forward_model = ForwardModel(simulator, starts, LawBlock([]), sensors, times[:count])
    none = torch.zeros(0, dtype=torch.float64)
    objective = LeastSquaresProblem(forward_model, values, noise, none)
    begin = torch.zeros(starts.size, dtype=torch.float64)
    z = minimise(objective, begin, STEPS, TOLERANCE).phi[None]
    return replace(forward_model, times=times).states(z, z[:, :0])[0, count:, 0]
