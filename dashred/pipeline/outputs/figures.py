"""Figures of an analysis with equations, by file name."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial

from matplotlib.figure import Figure

from dashred.core.findings.schema import Findings
from dashred.core.units import time_label
from dashred.pipeline.analysis import Analysis
from dashred.pipeline.outputs.field_figures import draw_fields, draw_forcing, draw_where
from dashred.pipeline.outputs.method_figures import (
    draw_coefficients,
    draw_learning,
    draw_sparsity,
)
from dashred.pipeline.outputs.sensor_figures import (
    draw_forecast,
    draw_sensor_errors,
    draw_traces,
    draw_verification,
    draw_whole_episode,
    sensor_errors,
)
from dashred.pipeline.problem import Problem
from dashred.reporting.figures.figure_names import (
    HELD_OUT_EPISODE,
    SENSOR_ERRORS,
    sensor_figure_of_episode,
)
from dashred.reporting.figures.save import evidence_figure, force_over_time

Figures = Mapping[str, Callable[[], Figure]]
"""Functions that draw the figures, by file name."""

PANEL_METHODS = ("simulation", "dashred", "corrected")


def figures_of(problem: Problem, analysis: Analysis, findings: Findings) -> Figures:
    """Return the figures in the order in which they are drawn."""
    figures: dict[str, Callable[[], Figure]] = {}
    for number, (episode, results) in enumerate(analysis.episodes(problem), start=1):
        figures[sensor_figure_of_episode(number)] = partial(draw_traces, episode, results)
    for whole, free in zip(problem.whole, analysis.trajectories.whole, strict=True):
        figures[HELD_OUT_EPISODE] = partial(
            draw_whole_episode, whole, free, analysis.discovery.best
        )
    if sensor_errors(problem, analysis):
        figures[SENSOR_ERRORS] = partial(draw_sensor_errors, problem, analysis)
    if analysis.assimilated.proposals:
        figures["coefficients.png"] = partial(draw_coefficients, problem, analysis.assimilated)
        figures["sparsity.png"] = partial(draw_sparsity, analysis)
    figures["learning.png"] = partial(_learning, analysis)
    figures["verification.png"] = partial(draw_verification, problem, analysis, findings)
    where, is_told = findings["where"], findings["terms"] is not None
    if is_told:
        figures["forecast.png"] = partial(draw_forecast, problem, analysis)
        figures["evidence.png"] = partial(_evidence, analysis, findings)
    if where is not None:
        forcing = where["forcing"]
        if len(problem.system.axes) == 1 and forcing is not None:
            figures["forcing.png"] = partial(draw_forcing, problem, forcing, where["source"])
        if not problem.system.axes and forcing is not None:
            clock = time_label(problem.system.units)
            figures["forcing.png"] = partial(force_over_time, forcing, clock)
        if is_told:
            figures["where.png"] = partial(draw_where, problem, analysis, where)
    if axes := len(problem.system.axes):
        name = "space_time.png" if axes == 1 else "snapshots.png"
        figures[name] = partial(_fields, problem, analysis)
    return figures


def _learning(analysis: Analysis) -> Figure:
    return draw_learning(
        {
            "SHRED, unseen simulations": analysis.network.curves["rmse/field_members"],
            "DA-SHRED, fitted": analysis.assimilated.curves["rmse/sensors_fit"],
            "DA-SHRED, validation": analysis.assimilated.curves["rmse/sensors_validate"],
            "corrected SHRED": analysis.corrected_network.curves["rmse/field_members"],
        }
    )


def _evidence(analysis: Analysis, findings: Findings) -> Figure:
    discovery = analysis.discovery
    path = [(len(best.candidates), best.score) for best in discovery.path]
    return evidence_figure(path, findings["terms"] or [], discovery.path_index)


def _fields(problem: Problem, analysis: Analysis) -> Figure:
    estimates = analysis.estimates(len(problem.split.fit.times))
    return draw_fields(problem, {name: x for name, x in estimates.items() if name in PANEL_METHODS})
