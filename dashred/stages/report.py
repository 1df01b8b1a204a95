"""Draw what the analysis itself may show: no truth is in reach here."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Literal, cast

import numpy as np

from dashred.discovery.location import law_tendency
from dashred.discovery.regression import SparseFit
from dashred.discovery.wording import words
from dashred.findings import Findings, Where
from dashred.physics.system import Term
from dashred.progress import stage
from dashred.reporting import html
from dashred.reporting.figures import (
    LawMap,
    accuracy_against_sparsity,
    coefficients_against_epoch,
    epochs_and_values,
    evidence_figure,
    forcing_figure,
    forecast_figure,
    learning_curves,
    save_figure,
    sensor_traces,
    snapshot_panels,
    space_time_panels,
    verification_figure,
    where_figure,
)
from dashred.reporting.summary import summary
from dashred.reporting.verdict_words import nearly_all
from dashred.sensing.recording import Recording
from dashred.stages.analysis import Analysis
from dashred.stages.assimilation import Assimilated
from dashred.stages.problem import Problem
from dashred.stages.trajectories import Trajectories
from dashred.stages.verification import MISFITS
from dashred.units import in_brackets, time_label

Errors = Mapping[str, float | None]
Proof = Literal["test_sensors", "heldout_time", "heldout_restarted", "heldout_episode"]
HELD_OUT: tuple[Proof, ...] = (
    "test_sensors",
    "heldout_time",
    "heldout_restarted",
    "heldout_episode",
)
PANELS = ("simulation", "dashred", "corrected")
TITLES = {"alg1": "Algorithm 1", "alg2": "Algorithm 2"}
SENSORS, WHOLE = "All sensors", "held_out_episode.png"
FIGURES = {
    html.WHERE: {
        "Where the law acts, and at which sensors it shows": "where.png",
        "What a free forcing would add, where and when": "forcing.png",
    },
    html.WHAT: {"What was left out, and how sure that is": "evidence.png"},
    html.PROOF: {
        "What the law is worth on data that no fit has seen": "verification.png",
        "The episode that was held out whole, from a start fitted to its beginning": WHOLE,
        "The reconstructed field": "space_time.png",
        "The reconstructed field, at three times": "snapshots.png",
        SENSORS: "sensor_traces.png",
    },
    html.FORECAST: {"The sensors, foretold with and without the law": "forecast.png"},
    html.METHOD: {
        "What latent SINDy proposes, by epoch": "coefficients.png",
        "Accuracy against sparsity: latent SINDy, and the law": "sparsity.png",
        "Learning": "learning.png",
    },
}


def report(
    problem: Problem,
    analysis: Analysis,
    findings: Findings,
    output: Path,
    seconds: dict[str, float],
) -> None:
    """Save every figure of the analysis in ``output``, and the page that holds them."""
    with stage("draw figures", seconds):
        for (episode, mine), name in zip(
            analysis.episodes(problem), _trace_files(problem).values(), strict=True
        ):
            _traces(episode, mine, output / name)
        for whole, free in zip(problem.whole, analysis.free.whole, strict=True):
            _whole(whole, free, output / WHOLE)
        _coefficients(problem, analysis.found, output)
        _sparsity(analysis, output)
        _curves(analysis, output)
        _verification(problem, analysis, findings, output)
        if findings["where"] is not None:
            _forecast(problem, analysis, output)
            path = [(len(best.candidates), best.score) for best in analysis.discovered.path]
            save_figure(evidence_figure(path, findings["terms"] or []), output / "evidence.png")
            _where(problem, analysis, findings["where"], output)
        if problem.system.axes:
            _fields(problem, analysis, output)
        files = FIGURES | {html.PROOF: FIGURES[html.PROOF] | _trace_files(problem)}
        figures = {
            part: {
                title: output / name for title, name in drawn.items() if (output / name).is_file()
            }
            for part, drawn in files.items()
        }
        text, mostly = summary(findings, None, {}), _mostly(problem, findings)
        html.write_html(output / "report.html", findings, figures, text, mostly)


def _mostly(problem: Problem, findings: Findings) -> list[str]:
    """Return the words of the few terms that explain nearly all of what many do."""
    few, system = nearly_all(findings), problem.system
    found = []
    for term in few["terms"] if few else []:
        if (equation := term["equation"]) is None:
            return []
        expr = system.parse(term["term"], f"library.{equation}", equation=equation)
        found.append(words(system, equation, expr, term["coefficient"], 0.0))
    return found


def _trace_files(problem: Problem) -> dict[str, str]:
    """Return the figure of every fitted episode's sensors, by caption."""
    return {SENSORS: FIGURES[html.PROOF][SENSORS]} | {
        f"{SENSORS} in episode {episode.name}": f"sensor_traces_{number}.png"
        for number, episode in enumerate(problem.others, start=2)
    }


def _verification(problem: Problem, analysis: Analysis, findings: Findings, output: Path) -> None:
    tested = problem.split.tested
    operator, total = problem.operator(tested), len(problem.times)
    traces = {
        MISFITS[name]: operator(states[:total]).numpy()
        for name, states in analysis.free.states.items()
    }
    fit = findings["fit"]
    errors: dict[str, Errors] = {name: cast(Errors, fit.get(name) or {}) for name in HELD_OUT}
    figure = verification_figure(
        problem.times.numpy(),
        tested.values,
        list(tested.names),
        traces,
        problem.split.time_end,
        errors,
        reading_units(problem, tested),
        time_label(problem.system.units),
    )
    save_figure(figure, output / "verification.png")


def _forecast(problem: Problem, analysis: Analysis, output: Path) -> None:
    """Draw sensors of the held-out time on beyond the recording."""
    free, heldout = analysis.free, problem.split.heldout
    recorded = _recorded(problem, list(heldout.names))
    operator = problem.operator(heldout)
    traces = {
        MISFITS[name]: operator(free.states[name]).numpy()
        for name in ("simulation_refit", "corrected")
    }
    figure = forecast_figure(
        free.times.numpy(),
        recorded,
        list(heldout.names),
        traces,
        reading_units(problem, heldout),
        time_label(problem.system.units),
    )
    save_figure(figure, output / "forecast.png")


def reading_units(problem: Problem, recording: Recording) -> dict[str, str]:
    """Return the unit of what each sensor reads, where it is stated."""
    units = problem.system.units
    return {s.name: units[s.reads] for s in recording.sensors if s.reads in units}


def _where(problem: Problem, analysis: Analysis, where: Where, output: Path) -> None:
    system, fit = problem.system, problem.split.fit
    count, law_map = len(fit.times), None
    if len(system.axes) == 1:
        [axis] = system.axes
        states = analysis.free.states["corrected"][:count]
        tendency = law_tendency(system, analysis.discovered.best, states, problem.times[:count])
        law_map = LawMap(
            axis.name,
            system.grid.own_coordinates[axis.name].numpy(),
            problem.times[:count].numpy(),
            system.grid.own(tendency.square().sum(dim=1).sqrt()).numpy(),
            {sensor.name: sensor.position[0] for sensor in fit.sensors},
        )
        if where["forcing"] is not None:
            places = list(law_map.sensors.values())
            label, clock = (
                in_brackets(axis.name, system.units.get(axis.name)),
                time_label(system.units),
            )
            figure = forcing_figure(where["forcing"], label, axis.length, places, clock)
            save_figure(figure, output / "forcing.png")
    save_figure(where_figure(where, law_map, system.units), output / "where.png")


def _all_sensors(problem: Problem) -> tuple[Recording, dict[str, str]]:
    """Return the parts of the split together again, and the role of every sensor."""
    split = problem.split
    parts = [split.fit, split.validation, split.tested]
    sensors = {s.name: s for part in parts for s in part.sensors}
    roles = {name: "test" for name in split.test} | {name: "validate" for name in split.validate}
    roles |= {name: "extra" for name in split.extra} | {name: "input" for name in split.inputs}
    recorded = _recorded(problem, list(sensors))
    return Recording(tuple(sensors.values()), problem.times.numpy(), recorded), roles


def _whole(problem: Problem, free: Trajectories, path: Path) -> None:
    """Draw the episode that was held out whole, and what runs from its beginning make of it."""
    recording, roles = _all_sensors(problem)
    operator, total = problem.operator(recording), len(problem.times)
    compared = ("simulation_refit", "corrected")
    traces = {MISFITS[name]: operator(free.states[name][:total]).numpy() for name in compared}
    _draw_sensors(problem, recording, roles, traces, path)


def _draw_sensors(
    problem: Problem,
    recording: Recording,
    roles: Mapping[str, str],
    traces: Mapping[str, np.ndarray],
    path: Path,
) -> None:
    figure = sensor_traces(
        recording.times,
        recording.values,
        list(recording.names),
        roles,
        traces,
        problem.split.time_end,
        reading_units(problem, recording),
        time_label(problem.system.units),
    )
    save_figure(figure, path)


def _traces(problem: Problem, analysis: Analysis, path: Path) -> None:
    split = problem.split
    recording, roles = _all_sensors(problem)
    operator, sensors = problem.operator(recording), recording.sensors
    total, count = len(problem.times), len(split.fit.times)
    states = analysis.free.states["corrected"][:total]
    traces = {"simulation": operator(analysis.nominal.states).numpy()}
    traces["corrected"] = operator(states).numpy()
    for name in ("shred", "dashred"):
        known = operator(analysis.estimates(count)[name]).numpy()
        traces[name] = np.full((total, len(sensors)), np.nan)
        traces[name][:count] = known
    _draw_sensors(problem, recording, roles, traces, path)


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
    panels = {
        title: varying(problem.library, np.array(found.coefficients[name]))
        for name, title in TITLES.items()
    }
    figure = coefficients_against_epoch(
        np.array(found.epochs), panels, "What latent SINDy proposes, by epoch of assimilation"
    )
    save_figure(figure, output / "coefficients.png")


def varying(library: list[Term], history: np.ndarray) -> dict[str, np.ndarray]:
    """Return the coefficients by epoch, ``(epoch,)`` by term, that are not always zero."""
    return {
        f"{term.equation}: {term}": history[:, j]
        for j, term in enumerate(library)
        if history.size and np.any(history[:, j] != 0)
    }


def _sparsity(analysis: Analysis, output: Path) -> None:
    latent = {TITLES[name]: _path(fit) for name, fit in analysis.found.proposals.items()}
    discovered = analysis.discovered
    law = [(len(best.candidates), best.rmse, best.score) for best in discovered.path]
    figure = accuracy_against_sparsity(latent, law)
    save_figure(figure, output / "sparsity.png")


def _path(fit: SparseFit) -> tuple[np.ndarray, np.ndarray, int]:
    sizes, errors = zip(*fit.path, strict=True)
    return np.array(sizes), np.array(errors), int(np.count_nonzero(fit.coefficients))


def _curves(analysis: Analysis, output: Path) -> None:
    named = {
        "SHRED, unseen simulations": analysis.learned.curves["rmse/field_members"],
        "DA-SHRED, fitted": analysis.found.curves["rmse/sensors_fit"],
        "DA-SHRED, validation": analysis.found.curves["rmse/sensors_validate"],
        "corrected SHRED": analysis.relearned.curves["rmse/field_members"],
    }
    curves = {name: epochs_and_values(points) for name, points in named.items()}
    save_figure(learning_curves(curves, "RMSE / standard deviation"), output / "learning.png")


def _fields(problem: Problem, analysis: Analysis, output: Path) -> None:
    system, split = problem.system, problem.split
    count = len(split.fit.times)
    times, coordinates = problem.times[:count].numpy(), system.grid.own_coordinates
    fields = {
        field: {
            name: system.grid.own(states[:, i]).numpy()
            for name, states in analysis.estimates(count).items()
            if name in PANELS
        }
        for i, field in enumerate(system.fields)
    }
    places = {
        field: [s.position for s in split.fit.sensors if s.reads == field]
        for field in system.fields
    }
    if len(system.axes) == 1:
        [axis] = system.axes
        figure = space_time_panels(
            times,
            in_brackets(axis.name, system.units.get(axis.name)),
            coordinates[axis.name].numpy(),
            fields,
            {field: [x for (x,) in positions] for field, positions in places.items()},
            meanings={
                field: in_brackets(meaning, system.units.get(field))
                for field, meaning in system.config.fields.items()
            },
            clock=time_label(system.units),
        )
        save_figure(figure, output / "space_time.png")
    else:
        along = {name: x.numpy() for name, x in coordinates.items()}
        save_figure(
            snapshot_panels(times, along, fields, places, system.units), output / "snapshots.png"
        )
