"""Figures and report of an analysis from snapshots."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from dashred.core.findings.schema import Findings
from dashred.core.progress import stage
from dashred.pipeline.outputs.field_figures import draw_fields
from dashred.pipeline.outputs.figures import Figures
from dashred.pipeline.outputs.method_figures import draw_coefficients, draw_learning
from dashred.pipeline.outputs.sensor_figures import all_sensors, draw_sensors
from dashred.pipeline.problem import Problem
from dashred.pipeline.run.provenance import git_commit
from dashred.pipeline.snapshots.black_box_analysis import BlackBoxAnalysis
from dashred.reporting.figures.figure_names import OF_SNAPSHOTS
from dashred.reporting.figures.gallery import Gallery
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
        gallery.draw(figures_of(problem, analysis))
        figures = gallery.captioned(OF_SNAPSHOTS)
        text = summary(findings, None, {})
        html.write_html(output / "report.html", findings, figures, text, commit=git_commit())
    return gallery.drawn


def figures_of(problem: Problem, analysis: BlackBoxAnalysis) -> Figures:
    """Return all figures, in the order in which they are drawn."""
    figures: dict[str, Callable[[], Figure]] = {
        "sensor_traces.png": partial(_traces, problem, analysis),
        "coefficients.png": partial(draw_coefficients, problem, analysis.assimilated),
        "learning.png": partial(_learning, analysis),
    }
    if axes := len(problem.system.axes):
        name = "space_time.png" if axes == 1 else "snapshots.png"
        figures[name] = partial(draw_fields, problem, analysis.fields)
    return figures


def _traces(problem: Problem, analysis: BlackBoxAnalysis) -> Figure:
    every, total = all_sensors(problem), len(problem.times)
    operator, traces = problem.operator(every), {}
    for method, states in analysis.fields.items():
        traces[method] = np.full((total, len(every.sensors)), np.nan)
        traces[method][: len(states)] = operator(states).numpy()
    return draw_sensors(problem, every, traces)


def _learning(analysis: BlackBoxAnalysis) -> Figure:
    return draw_learning(
        {
            "SHRED, unseen snapshots": analysis.network.curves["rmse/field_members"],
            "DA-SHRED, fitted": analysis.assimilated.curves["rmse/sensors_fit"],
            "DA-SHRED, validation": analysis.assimilated.curves["rmse/sensors_validate"],
        }
    )
