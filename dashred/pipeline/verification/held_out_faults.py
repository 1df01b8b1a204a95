"""Faults of sensors that no fit has used, judged by the final model.

They change neither the law nor its fit. Without this a faulty validation or test sensor would only
show as a large error of the corrected simulation.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from itertools import product

import numpy as np
import torch
from torch import Tensor

from dashred.data.observation_operator import ObservationOperator
from dashred.data.sensors import Sensor
from dashred.data.stated.relative_noise import Array
from dashred.inference.fit.law import Law, SensorFault
from dashred.inference.fit.least_squares import LeastSquaresProblem
from dashred.inference.fit.noise_model import NoiseModel
from dashred.inference.forward.candidate_simulator import CandidateSimulator
from dashred.inference.forward.episodes import stack_readings, stack_times
from dashred.inference.forward.forward_model import ForwardModel
from dashred.inference.forward.law_block import LawBlock
from dashred.inference.forward.sensor_block import SensorBlock
from dashred.inference.forward.simulator import Simulator
from dashred.inference.hypotheses.result import MIN_FORCING_GAIN
from dashred.inference.initial_state.start_models import ScaledStart, project_state
from dashred.inference.results.corrected_system import build_corrected_system
from dashred.inference.sensor_faults.fault_search import FaultProblem, find_faults
from dashred.inference.sensor_faults.fault_table import (
    DISTINCT_KINDS,
    SEARCHED_KINDS,
    fault_in_units,
)
from dashred.inference.sensor_faults.neighbours import has_neighbours
from dashred.pipeline.analysis import Analysis
from dashred.pipeline.discovery.least_squares import stack_samples
from dashred.pipeline.problem import Problem
from dashred.pipeline.verification.sensor_noise import noise_of_sensors

# A fault must lower the score by more than this: the model was not fitted to these sensors.
MARGIN = 20.0
# If the model and the faults leave a larger χ²/n, the model is not good enough to judge sensors.
MAX_CHI2 = 1.5


@torch.no_grad()
def held_out_faults(problem: Problem, analysis: Analysis) -> list[SensorFault]:
    """Return the faults of validation and test sensors over the fit window.

    The start is adjusted to all sensors, so that its uncertainty is not taken for a fault. Fewer
    than half of these sensors can be told to be faulty; otherwise the model may be wrong.
    """
    held_out = (*problem.split.validate, *problem.split.test)
    if not held_out or analysis.discovery.forcing_gain > MIN_FORCING_GAIN:
        return []
    objective, phi = _problem_of_all_sensors(problem, analysis)
    names = [sensor.name for sensor in objective.forward_model.sensors.sensors]
    columns = [index for index, name in enumerate(names) if name in held_out]
    normal = objective.linearise(phi)
    if not normal.is_finite:
        return []
    linearised = FaultProblem.at(objective, phi, normal)
    count = max(1, (len(held_out) - 1) // 2)
    kinds = _kinds_beside(analysis.discovery.best)
    found = find_faults(linearised, columns, kinds, count, MARGIN)
    if not found.faults or found.cost > MAX_CHI2 * objective.noise.count:
        return []
    estimates = zip(found.faults, found.parameters, found.covariances, strict=True)
    return [fault_in_units(objective, *each) for each in estimates]


def err_next_to(
    problem: Problem, fitted: Sequence[SensorFault], others: Sequence[SensorFault]
) -> bool:
    """Return whether a sensor that no fit has used errs next to a fitted one that errs.

    Args:
        problem: recording and settings.
        fitted: faults of fitted sensors.
        others: faults of other sensors.
    """
    sensors = _all_sensors(problem)
    by_name = {sensor.name: sensor for sensor in sensors}
    pairs = (
        [by_name[fault.sensor] for fault in pair if fault.kind not in DISTINCT_KINDS]
        for pair in product(fitted, others)
    )
    return any(has_neighbours(sensors, pair, problem.system.axes) for pair in pairs)


def _all_sensors(problem: Problem) -> tuple[Sensor, ...]:
    """Return the sensors for the fit, for validation and for the test."""
    split = problem.split
    validated = (s for s in split.validation.sensors if s.name in split.validate)
    return (*split.fit.sensors, *validated, *split.tested.sensors)


def _kinds_beside(law: Law) -> Collection[str]:
    """Return the kinds of faults that can be told beside a law.

    The shape of a source, the edges of a region and the modes of a start are approximations. What
    they leave at a sensor that was not fitted varies slowly, as the error of a sensor may.
    """
    is_exact = law.source is None and law.window is None and law.start_prior_factor == 1
    return SEARCHED_KINDS if is_exact else DISTINCT_KINDS


def _problem_of_all_sensors(
    problem: Problem, analysis: Analysis
) -> tuple[LeastSquaresProblem, Tensor]:
    """Return F of the start for all sensors under the best law, and the fitted start."""
    law, episodes, split = analysis.discovery.best, problem.episodes, problem.split
    names = (*split.fit.names, *split.validate, *split.test)
    parts = [_readings_of(episode) for episode in episodes]
    parts_of_simulator = [
        CandidateSimulator(system, system.dt, [])
        for system in (build_corrected_system(episode.system, law) for episode in episodes)
    ]
    start = analysis.nominal.start
    if law.start_prior_factor > 1:
        start = ScaledStart(start, law.start_prior_factor)
    operator = ObservationOperator(_all_sensors(problem), problem.sensed)
    times = stack_times([e.times[: len(e.split.fit.times)] for e in episodes])
    forward_model = ForwardModel(
        Simulator(parts_of_simulator),
        start,
        LawBlock([]),
        SensorBlock(operator, len(episodes)),
        times,
    )
    recorded = stack_readings(parts)
    noise = _noise(problem, analysis, names, recorded)
    none = torch.zeros(0, dtype=torch.float64)
    objective = LeastSquaresProblem(forward_model, recorded, noise, none)
    return objective, project_state(start, law.start)


def _readings_of(episode: Problem) -> Tensor:
    """Return the readings of all sensors over the fit window, ``(time, sensor)``."""
    split, count = episode.split, len(episode.split.fit.times)
    validation = split.validation.select(split.validate).values if split.validate else None
    parts = [split.fit.values, validation, split.tested.values[:count]]
    return torch.cat([torch.from_numpy(part) for part in parts if part is not None], dim=1)


def _noise(
    problem: Problem, analysis: Analysis, names: tuple[str, ...], recorded: Tensor
) -> NoiseModel:
    """Return the noise of all sensors, with the correlation of the fitted ones."""
    found = analysis.discovery.noise
    by_name = noise_of_sensors(problem, analysis, names)
    std = torch.tensor([by_name[name] for name in names], dtype=torch.float64)
    correlation = torch.full_like(std, float(found.correlation.max()))
    available = ~recorded.isnan()
    episodes = len(problem.episodes)
    faulty = {fault.sensor for fault in analysis.discovery.best.faults}
    for column, name in enumerate(names * episodes):
        available[:, column] &= name not in faulty
    sizes = [_relative_noise_of(episode) for episode in problem.episodes]
    return NoiseModel(
        std.repeat(episodes),
        correlation.repeat(episodes),
        available,
        stack_samples(sizes, torch.ones_like(recorded)),
    )


def _relative_noise_of(episode: Problem) -> Array | None:
    """Return the relative noise of all sensors over the fit window, ``(time, sensor)``."""
    split, count = episode.split, len(episode.split.fit.times)
    parts = [split.fit, split.tested.samples(slice(count))]
    if split.validate:
        # Without validation sensors, it contains a part of the samples of the fitted ones.
        parts.insert(1, split.validation.select(split.validate).samples(slice(count)))
    found = [(part, episode.relative_noise(part)) for part in parts]
    if all(sizes is None for _, sizes in found):
        return None
    ones = [np.ones_like(part.values) if sizes is None else sizes for part, sizes in found]
    return np.concatenate(ones, axis=1)
