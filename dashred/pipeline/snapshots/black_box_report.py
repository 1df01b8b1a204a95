"""Figures and report of an analysis from snapshots."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from dashred.core.findings.schema import Findings
from dashred.core.progress import stage
from dashred.core.units import label_with_unit, time_label
from dashred.pipeline.outputs.report import TITLES, varying
from dashred.pipeline.outputs.sensor_figures import all_sensors, draw_sensors
from dashred.pipeline.problem import Problem
from dashred.pipeline.run.provenance import git_commit
from dashred.pipeline.snapshots.black_box_analysis import BlackBoxAnalysis
from dashred.reporting.figures.figure_names import OF_SNAPSHOTS
from dashred.reporting.figures.gallery import Gallery
from dashred.reporting.figures.save import (
    coefficients_against_epoch,
    epochs_and_values,
    learning_curves,
    snapshot_panels,
    space_time_panels,
)
from dashred.reporting.page import html
from dashred.reporting.text.summary import summary


def report(
    problem: Problem,
    analysis: BlackBoxAnalysis,
    findings: Findings,
    output: Path,
    seconds: dict[str, float],
) -> list[Path]:
    """Save the figures and the report in ``output``; return the figures."""
    gallery = Gallery(output)
    with stage("draw figures", seconds):
        _traces(problem, analysis, gallery)
        _coefficients(problem, analysis, gallery)
        _curves(analysis, gallery)
        if problem.system.axes:
            _fields(problem, analysis, gallery)
        figures = gallery.captioned(OF_SNAPSHOTS)
        text = summary(findings, None, {})
        html.write_html(output / "report.html", findings, figures, text, commit=git_commit())
    return gallery.drawn


def _traces(problem: Problem, analysis: BlackBoxAnalysis, gallery: Gallery) -> None:
    every, total = all_sensors(problem), len(problem.times)
    operator, traces = problem.operator(every), {}
    for method, states in analysis.fields.items():
        traces[method] = np.full((total, len(every.sensors)), np.nan)
        traces[method][: len(states)] = operator(states).numpy()
    draw_sensors(problem, every, traces, gallery, "sensor_traces.png")


def _coefficients(problem: Problem, analysis: BlackBoxAnalysis, gallery: Gallery) -> None:
    found = analysis.found
    panels = {
        title: varying(problem.library, np.array(found.coefficients[name]))
        for name, title in TITLES.items()
    }
    title = "What latent SINDy proposes, by epoch of assimilation"
    figure = coefficients_against_epoch(np.array(found.epochs), panels, title)
    gallery.save(figure, "coefficients.png")


def _curves(analysis: BlackBoxAnalysis, gallery: Gallery) -> None:
    named = {
        "SHRED, unseen snapshots": analysis.learned.curves["rmse/field_members"],
        "DA-SHRED, fitted": analysis.found.curves["rmse/sensors_fit"],
        "DA-SHRED, validation": analysis.found.curves["rmse/sensors_validate"],
    }
    curves = {name: epochs_and_values(points) for name, points in named.items()}
    gallery.save(learning_curves(curves, "RMSE / standard deviation"), "learning.png")


def _fields(problem: Problem, analysis: BlackBoxAnalysis, gallery: Gallery) -> None:
    system, fit = problem.system, problem.split.fit
    count = len(fit.times)
    fields = {
        field: {
            name: system.grid.own(states[:count, i]).numpy()
            for name, states in analysis.fields.items()
        }
        for i, field in enumerate(system.fields)
    }
    places = {
        field: [s.position for s in fit.sensors if s.reads == field] for field in system.fields
    }
    along = {name: x.numpy() for name, x in system.grid.own_coordinates.items()}
    times = problem.times[:count].numpy()
    if len(system.axes) == 1:
        [axis], meanings = system.axes, system.config.fields
        sensors = {field: [x for (x,) in positions] for field, positions in places.items()}
        units = system.units
        figure = space_time_panels(
            times,
            label_with_unit(axis.name, units.get(axis.name)),
            along[axis.name],
            fields,
            sensors,
            meanings={f: label_with_unit(says, units.get(f)) for f, says in meanings.items()},
            clock=time_label(units),
        )
        gallery.save(figure, "space_time.png")
    else:
        gallery.save(snapshot_panels(times, along, fields, places, system.units), "snapshots.png")
