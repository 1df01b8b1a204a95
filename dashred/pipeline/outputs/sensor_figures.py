"""Figures of the sensors: recorded values and the estimates of the methods."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Literal, cast

import numpy as np
from matplotlib.figure import Figure
from torch import Tensor

from dashred.core.findings.schema import Findings
from dashred.core.units import time_label
from dashred.data.recording import Recording
from dashred.inference.fit.law import ErrorCurve, Law
from dashred.inference.results.sensor_offset import sensor_offset
from dashred.pipeline.analysis import Analysis
from dashred.pipeline.problem import Problem
from dashred.pipeline.trajectories import Trajectories
from dashred.reporting.figures.save import (
    SensorError,
    error_curves_figure,
    forecast_figure,
    sensor_traces,
    verification_figure,
)

Errors = Mapping[str, float | None]
Proof = Literal["test_sensors", "heldout_time", "heldout_restarted", "heldout_episode"]
HELD_OUT: tuple[Proof, ...] = (
    "test_sensors",
    "heldout_time",
    "heldout_restarted",
    "heldout_episode",
)


def draw_verification(problem: Problem, analysis: Analysis, findings: Findings) -> Figure:
    """Draw the test sensors with and without the law, and the errors of all methods."""
    tested = problem.split.tested
    operator, total = problem.operator(tested), len(problem.times)
    traces = {
        name: operator(states[:total]).numpy()
        for name, states in analysis.trajectories.states.items()
    }
    fit = findings["fit"]
    errors: dict[str, Errors] = {name: cast(Errors, fit.get(name) or {}) for name in HELD_OUT}
    return verification_figure(
        problem.times.numpy(),
        tested.values,
        list(tested.names),
        traces,
        problem.split.time_end,
        errors,
        reading_units(problem, tested),
        time_label(problem.system.units),
    )


def draw_forecast(problem: Problem, analysis: Analysis) -> Figure:
    """Draw the sensors and the free runs through the held-out time and the forecast."""
    free, heldout = analysis.trajectories, problem.split.heldout
    recorded = _recorded(problem, list(heldout.names))
    traces = {
        "simulation_refit": problem.operator(heldout)(free.states["simulation_refit"]).numpy(),
        "corrected": _corrected_readings(
            problem, heldout, analysis.discovery.best, free.states["corrected"], free.times
        ),
    }
    return forecast_figure(
        free.times.numpy(),
        recorded,
        list(heldout.names),
        traces,
        reading_units(problem, heldout),
        time_label(problem.system.units),
    )


def sensor_errors(problem: Problem, analysis: Analysis) -> list[SensorError]:
    """Return the error curves of the wandering sensors, by sensor and episode."""
    episodes = analysis.episodes(problem)
    return [
        _sensor_error(*episodes[curve.episode], fault.sensor, curve, len(episodes) > 1)
        for fault in analysis.discovery.best.faults
        for curve in fault.curves
    ]


def draw_sensor_errors(problem: Problem, analysis: Analysis) -> Figure:
    """Draw the error curves of the wandering sensors."""
    clock = time_label(problem.system.units)
    return error_curves_figure(sensor_errors(problem, analysis), clock)


def _sensor_error(
    problem: Problem, analysis: Analysis, sensor: str, curve: ErrorCurve, has_name: bool
) -> SensorError:
    recording = all_sensors(problem).select([sensor])
    states = analysis.trajectories.states["corrected"][: len(problem.times)]
    simulated = problem.operator(recording)(states).numpy()
    return SensorError(
        f"{sensor}, {problem.name}" if has_name else sensor,
        problem.times.numpy(),
        recording.values[:, 0] - simulated[:, 0],
        np.array(curve.times),
        np.array(curve.value),
        np.array(curve.std),
        problem.split.time_end,
        reading_units(problem, recording).get(sensor),
    )


def reading_units(problem: Problem, recording: Recording) -> dict[str, str]:
    """Return the units of the readings by sensor, if they are stated."""
    units = problem.system.units
    return {s.name: units[s.reads] for s in recording.sensors if s.reads in units}


def all_sensors(problem: Problem) -> Recording:
    """Return the recording of all sensors over the whole episode."""
    split = problem.split
    parts = [split.fit, split.validation, split.tested]
    sensors = {s.name: s for part in parts for s in part.sensors}
    recorded = _recorded(problem, list(sensors))
    return Recording(tuple(sensors.values()), problem.times.numpy(), recorded)


def draw_whole_episode(problem: Problem, free: Trajectories, law: Law) -> Figure:
    """Draw the episode that was held out as a whole, with free runs from its beginning."""
    recording = all_sensors(problem)
    states = free.over(slice(len(problem.times)))
    traces = {
        "simulation_refit": problem.operator(recording)(states["simulation_refit"]).numpy(),
        "corrected": _corrected_readings(
            problem, recording, law, states["corrected"], problem.times
        ),
    }
    return draw_sensors(problem, recording, traces)


def draw_sensors(
    problem: Problem, recording: Recording, traces: Mapping[str, np.ndarray]
) -> Figure:
    """Draw the recorded values and the traces of methods, each ``(time, sensor)``."""
    return sensor_traces(
        recording.times,
        recording.values,
        list(recording.names),
        problem.split.roles,
        traces,
        problem.split.time_end,
        reading_units(problem, recording),
        time_label(problem.system.units),
    )


def draw_traces(problem: Problem, analysis: Analysis) -> Figure:
    """Draw all sensors of a fitted episode with the estimates of the methods."""
    split = problem.split
    recording = all_sensors(problem)
    operator, sensors = problem.operator(recording), recording.sensors
    total, count = len(problem.times), len(split.fit.times)
    states = analysis.trajectories.states["corrected"][:total]
    traces = {"simulation": operator(analysis.nominal.states).numpy()}
    traces["corrected"] = _corrected_readings(
        problem, recording, analysis.discovery.best, states, problem.times
    )
    for method in ("shred", "dashred"):
        readings = operator(analysis.estimates(count)[method]).numpy()
        traces[method] = np.full((total, len(sensors)), np.nan)
        traces[method][:count] = readings
    return draw_sensors(problem, recording, traces)


def _corrected_readings(
    problem: Problem, recording: Recording, law: Law, states: Tensor, times: Tensor
) -> np.ndarray:
    """Return the readings of the corrected simulator, ``(time, sensor)``.

    They contain the bias or the drift of a faulty sensor.

    Args:
        problem: the episode.
        recording: gives the sensors.
        law: the explanation.
        states: of the corrected simulator, ``(time, field, *grid)``.
        times: of these states, ``(time,)``.
    """
    offset = sensor_offset(law, recording.names, times - times[0])
    return problem.operator(recording)(states).numpy() + np.nan_to_num(offset)


def _recorded(problem: Problem, names: list[str]) -> np.ndarray:
    """Join the parts of the split to one array, ``(time, sensor)``."""
    split, total = problem.split, len(problem.times)
    values = np.full((total, len(names)), np.nan)
    count = len(split.fit.times)
    for column, name in enumerate(names):
        if name in split.tested.names:
            values[:, column] = split.tested.select([name]).values[:, 0]
            continue
        early = split.fit if name in split.fit.names else split.validation
        values[:count, column] = early.select([name]).values[:, 0]
        values[count:, column] = split.heldout.select([name]).values[:, 0]
    return values
