"""Draw what the analysis itself may show: no truth is in reach here."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from dashred.discovery.regression import SparseFit
from dashred.physics.system import Term
from dashred.progress import stage
from dashred.reporting.figures import (
    coefficients_against_epoch,
    learning_curves,
    save_figure,
    sensor_traces,
    space_time_panels,
    sparsity_path,
)
from dashred.sensing.recording import Recording
from dashred.stages.assimilation import Assimilated
from dashred.stages.learning import Learned
from dashred.stages.problem import Problem
from dashred.stages.simulation import Nominal
from dashred.stages.verification import estimates


def report(
    problem: Problem,
    nominal: Nominal,
    learned: Learned,
    found: Assimilated,
    output: Path,
    seconds: dict[str, float],
) -> None:
    """Save every figure of the analysis in ``output``."""
    with stage("draw figures", seconds):
        _traces(problem, nominal, found, output)
        _coefficients(problem, found, output)
        _curves(learned, found, output)
        if len(problem.system.axes) == 1:
            _space_time(problem, nominal, found, output)


def _traces(problem: Problem, nominal: Nominal, found: Assimilated, output: Path) -> None:
    split = problem.split
    parts = [split.fit, split.validation, split.tested]
    sensors = {s.name: s for part in parts for s in part.sensors}
    roles = {name: "test" for name in split.test} | {name: "validate" for name in split.validate}
    roles |= {name: "extra" for name in split.extra} | {name: "input" for name in split.inputs}
    recorded = _recorded(problem, list(sensors))
    operator = problem.operator(Recording(tuple(sensors.values()), problem.times.numpy(), recorded))
    total, count = len(problem.times), len(split.fit.times)
    traces = {"simulation": operator(nominal.states).numpy()}
    for name in ("shred", "dashred"):
        known = operator(estimates(nominal, found, count)[name]).numpy()
        traces[name] = np.full((total, len(sensors)), np.nan)
        traces[name][:count] = known
    figure = sensor_traces(
        problem.times.numpy(), recorded, list(sensors), roles, traces, split.time_end
    )
    save_figure(figure, output / "sensor_traces.png")


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


def _coefficients(problem: Problem, found: Assimilated, output: Path) -> None:
    titles = {"alg1": "Algorithm 1", "alg2": "Algorithm 2"}
    panels = {
        titles[name]: _varying(problem.library, np.array(found.coefficients[name]))
        for name in titles
    }
    figure = coefficients_against_epoch(
        np.array(found.epochs), panels, "What latent SINDy proposes, by epoch of assimilation"
    )
    save_figure(figure, output / "coefficients.png")
    paths = {titles[name]: _path(fit) for name, fit in found.proposals.items()}
    save_figure(sparsity_path(paths), output / "sparsity.png")


def _varying(library: list[Term], history: np.ndarray) -> dict[str, np.ndarray]:
    return {
        f"{term.equation}: {term}": history[:, j]
        for j, term in enumerate(library)
        if history.size and np.any(history[:, j] != 0)
    }


def _path(fit: SparseFit) -> tuple[np.ndarray, np.ndarray, int]:
    sizes, errors = zip(*fit.path, strict=True)
    return np.array(sizes), np.array(errors), int(np.count_nonzero(fit.coefficients))


def _curves(learned: Learned, found: Assimilated, output: Path) -> None:
    named = {
        "SHRED, unseen simulations": learned.curves["rmse/field_members"],
        "DA-SHRED, fitted": found.curves["rmse/sensors_fit"],
        "DA-SHRED, validation": found.curves["rmse/sensors_validate"],
    }
    curves = {
        name: (np.array([epoch for epoch, _ in points]), np.array([value for _, value in points]))
        for name, points in named.items()
    }
    save_figure(learning_curves(curves, "RMSE / standard deviation"), output / "learning.png")


def _space_time(problem: Problem, nominal: Nominal, found: Assimilated, output: Path) -> None:
    system, split = problem.system, problem.split
    count = len(split.fit.times)
    fields = {
        field: {
            name: states[:, i].numpy() for name, states in estimates(nominal, found, count).items()
        }
        for i, field in enumerate(system.fields)
    }
    [axis] = system.axes
    places = {
        field: [s.position[0] for s in split.fit.sensors if s.reads == field]
        for field in system.fields
    }
    figure = space_time_panels(
        problem.times[:count].numpy(),
        axis.name,
        system.grid.coordinates[axis.name].numpy(),
        fields,
        places,
        meanings=system.config.fields,
    )
    save_figure(figure, output / "space_time.png")
