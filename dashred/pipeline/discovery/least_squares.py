"""The least-squares problem of discovery: simulator, sensors and noise."""

from __future__ import annotations

from collections.abc import Sequence

import torch
from torch import Tensor

from dashred.data.stated.relative_noise import Array
from dashred.data.stated.saturation import Mask, at_stop
from dashred.inference.fit.law import Law
from dashred.inference.fit.least_squares import LeastSquaresProblem
from dashred.inference.fit.noise_model import LEAST_NOISE, NoiseModel
from dashred.inference.forward.candidate_simulator import CandidateSimulator
from dashred.inference.forward.candidates import Candidate
from dashred.inference.forward.episodes import stack_readings, stack_times
from dashred.inference.forward.forward_model import ForwardModel
from dashred.inference.forward.law_block import LawBlock
from dashred.inference.forward.parameter_block import NO_PARAMETERS, ParameterBlock
from dashred.inference.forward.read_parameters import read_parameters
from dashred.inference.forward.sensor_block import SensorBlock
from dashred.inference.forward.simulator import Simulator
from dashred.inference.initial_state.start_models import StartModel
from dashred.physics.runs.resolution import Resolution
from dashred.physics.window import Shape
from dashred.pipeline.problem import Problem


def exact_simulator(
    problem: Problem,
    candidates: Sequence[Candidate],
    shapes: tuple[Shape, ...] = (),
    parameters: ParameterBlock = NO_PARAMETERS,
) -> Simulator:
    """Return the simulator of every episode; without inputs it is compiled only once.

    Its derivative uses longer time steps.

    Args:
        problem: the episodes and their systems.
        candidates: terms that may be missing.
        shapes: shapes of the windows in which they may act.
        parameters: uncertain parameters.
    """
    dt, whole = problem.ensemble_system.dt, [*parameters.candidates, *candidates]
    first = CandidateSimulator(problem.system, dt, whole, shapes)
    if not problem.system.inputs:
        return Simulator([first] * len(problem.episodes), parameters)
    others = (CandidateSimulator(e.system, dt, whole, shapes) for e in problem.others)
    return Simulator([first, *others], parameters)


def coarse_simulator(problem: Problem, simulator: Simulator, resolution: Resolution) -> Simulator:
    """Return the simulator that is used while the horizon is extended.

    It has the longer time steps of the derivative if their error stays below a third of the noise.
    The error grows with the fourth power of the step.
    """
    noise = float(noise_share(problem).median())
    longer = simulator.tangent.dt / simulator.system.dt
    return simulator.coarse() if resolution.error * longer**4 < noise / 3 else simulator


def trace_std(problem: Problem) -> Tensor:
    """Return the std of each fit sensor's trace, ``(episode·sensor,)``."""
    return torch.cat([torch.from_numpy(e.split.fit.trace_std()) for e in problem.episodes])


def noise_share(problem: Problem) -> Tensor:
    """Return σ of each fit sensor as a share of its trace's std, ``(episode·sensor,)``."""
    std = for_each_episode(problem, problem.noise_of(problem.split.fit.names))
    return std / trace_std(problem).clamp(min=1e-300)


def fit_noise(problem: Problem) -> NoiseModel:
    """Return the noise of the fit sensors before any fit."""
    std = for_each_episode(problem, problem.fit_noise_std())
    recorded = _recorded(problem)
    sizes = [e.relative_noise(e.split.fit) for e in problem.episodes]
    stops = [at_stop(e.split.fit) for e in problem.episodes]
    return NoiseModel(
        std,
        torch.zeros_like(std),
        ~torch.isnan(recorded),
        stack_samples(sizes, torch.ones_like(recorded)),
        stack_samples(stops, torch.zeros_like(recorded, dtype=torch.bool)),
        LEAST_NOISE * std,
    )


def stack_samples(episodes: Sequence[Array | Mask | None], default: Tensor) -> Tensor | None:
    """Return values of samples ``(time, sensor)`` by episode as ``(time, episode·sensor)``.

    Args:
        episodes: values of every episode; all or none are None, and then the result is None.
        default: value after the end of an episode, ``(time, episode·sensor)``.
    """
    count = default.shape[1] // len(episodes)
    for episode, each in enumerate(episodes):
        if each is None:
            return None
        default[: len(each), episode * count : (episode + 1) * count] = torch.from_numpy(each)
    return default


def noise_of_sound_sensors(problem: Problem, law: Law) -> NoiseModel:
    """Return the noise of one episode, with the samples of faulty sensors marked as missing.

    If no other sensor is left they are kept, because there would be nothing to fit.
    """
    noise, names = fit_noise(problem), problem.split.fit.names
    faulty = [names.index(fault.sensor) for fault in law.faults]
    if len(faulty) < len(names):
        noise.available[:, faulty] = False
    return noise


def for_each_episode(problem: Problem, values: Tensor) -> Tensor:
    """Repeat values of the sensors, ``(sensor,)``, for every episode, ``(episode·sensor,)``."""
    return values.repeat(len(problem.episodes))


def _recorded(problem: Problem) -> Tensor:
    return stack_readings([torch.from_numpy(e.split.fit.values) for e in problem.episodes])


def build_least_squares(
    problem: Problem,
    simulator: Simulator,
    start: StartModel,
    candidates: Sequence[Candidate],
    prior: float,
) -> LeastSquaresProblem:
    """Return the least-squares problem over the fit window.

    Args:
        problem: recording and settings.
        simulator: simulator with at least these candidates.
        start: model of the start.
        candidates: terms that may be missing.
        prior: prior std of each coefficient in units of its natural scale
            (docs/method.md#scales-and-priors).
    """
    episodes = problem.episodes
    fit, systems = problem.split.fit, [episode.system for episode in episodes]
    read = read_parameters(fit.sensors, systems)
    sensors = SensorBlock(problem.operator(fit), len(episodes), parameters=read)
    times = stack_times([e.times[: len(e.split.fit.times)] for e in episodes])
    law = LawBlock(candidates)
    forward_model = ForwardModel(simulator, start, law, sensors, times)
    return LeastSquaresProblem(
        forward_model, _recorded(problem), fit_noise(problem), prior * law.scales
    )
