"""Draw the sensors: what they recorded, and what every method makes of them."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Literal, cast

import numpy as np
from matplotlib.figure import Figure

from dashred.core.findings.schema import Findings
from dashred.core.units import time_label
from dashred.data.recording import Recording
from dashred.pipeline.analysis import Analysis
from dashred.pipeline.problem import Problem
from dashred.pipeline.trajectories import Trajectories
from dashred.reporting.figures.save import (
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
    """Draw the test sensors with and without the law, and every method's errors."""
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
    """Draw sensors of the held-out time on beyond the recording."""
    free, heldout = analysis.trajectories, problem.split.heldout
    recorded = _recorded(problem, list(heldout.names))
    operator = problem.operator(heldout)
    traces = {
        name: operator(free.states[name]).numpy() for name in ("simulation_refit", "corrected")
    }
    return forecast_figure(
        free.times.numpy(),
        recorded,
        list(heldout.names),
        traces,
        reading_units(problem, heldout),
        time_label(problem.system.units),
    )


def reading_units(problem: Problem, recording: Recording) -> dict[str, str]:
    """Return the unit of what each sensor reads, where it is stated."""
    units = problem.system.units
    return {s.name: units[s.reads] for s in recording.sensors if s.reads in units}


def all_sensors(problem: Problem) -> Recording:
    """Return the parts of the split together again."""
    split = problem.split
    parts = [split.fit, split.validation, split.tested]
    sensors = {s.name: s for part in parts for s in part.sensors}
    recorded = _recorded(problem, list(sensors))
    return Recording(tuple(sensors.values()), problem.times.numpy(), recorded)


def draw_whole_episode(problem: Problem, free: Trajectories) -> Figure:
    """Draw the episode that was held out whole, and what runs from its beginning make of it."""
    recording = all_sensors(problem)
    operator, total = problem.operator(recording), len(problem.times)
    compared = ("simulation_refit", "corrected")
    traces = {name: operator(free.states[name][:total]).numpy() for name in compared}
    return draw_sensors(problem, recording, traces)


def draw_sensors(
    problem: Problem, recording: Recording, traces: Mapping[str, np.ndarray]
) -> Figure:
    """Draw what sensors recorded, ``(time, sensor)``, and the traces of methods beside it."""
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
    """Draw all sensors of an episode that is fitted, with what the methods make of them."""
    split = problem.split
    recording = all_sensors(problem)
    operator, sensors = problem.operator(recording), recording.sensors
    total, count = len(problem.times), len(split.fit.times)
    states = analysis.trajectories.states["corrected"][:total]
    traces = {"simulation": operator(analysis.nominal.states).numpy()}
    traces["corrected"] = operator(states).numpy()
    for method in ("shred", "dashred"):
        known = operator(analysis.estimates(count)[method]).numpy()
        traces[method] = np.full((total, len(sensors)), np.nan)
        traces[method][:count] = known
    return draw_sensors(problem, recording, traces)


def _recorded(problem: Problem, names: list[str]) -> np.ndarray:
    """Put the parts of the split together again, ``(time, sensor)``."""
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
