"""The figures of an analysis of equations: what draws each of them, by file."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial

from matplotlib.figure import Figure

from dashred.core.findings.schema import Findings
from dashred.pipeline.analysis import Analysis
from dashred.pipeline.outputs.field_figures import draw_fields, draw_forcing, draw_where
from dashred.pipeline.outputs.method_figures import (
    draw_coefficients,
    draw_learning,
    draw_sparsity,
)
from dashred.pipeline.outputs.sensor_figures import (
    draw_forecast,
    draw_traces,
    draw_verification,
    draw_whole_episode,
)
from dashred.pipeline.problem import Problem
from dashred.reporting.figures.figure_names import HELD_OUT_EPISODE, sensor_figure_of_episode
from dashred.reporting.figures.save import evidence_figure

Figures = Mapping[str, Callable[[], Figure]]
"""What draws a figure, by the name of its file."""

PANELS = ("simulation", "dashred", "corrected")


def figures_of(problem: Problem, analysis: Analysis, findings: Findings) -> Figures:
    """Return all figures, in the order in which they are drawn."""
    found: dict[str, Callable[[], Figure]] = {}
    for number, (episode, mine) in enumerate(analysis.episodes(problem), start=1):
        found[sensor_figure_of_episode(number)] = partial(draw_traces, episode, mine)
    for whole, free in zip(problem.whole, analysis.free.whole, strict=True):
        found[HELD_OUT_EPISODE] = partial(draw_whole_episode, whole, free)
    found["coefficients.png"] = partial(draw_coefficients, problem, analysis.found)
    found["sparsity.png"] = partial(draw_sparsity, analysis)
    found["learning.png"] = partial(_learning, analysis)
    found["verification.png"] = partial(draw_verification, problem, analysis, findings)
    if (where := findings["where"]) is not None:
        found["forecast.png"] = partial(draw_forecast, problem, analysis)
        found["evidence.png"] = partial(_evidence, analysis, findings)
        if len(problem.system.axes) == 1 and where["forcing"] is not None:
            found["forcing.png"] = partial(draw_forcing, problem, where["forcing"])
        found["where.png"] = partial(draw_where, problem, analysis, where)
    if axes := len(problem.system.axes):
        name = "space_time.png" if axes == 1 else "snapshots.png"
        found[name] = partial(_fields, problem, analysis)
    return found


def _learning(analysis: Analysis) -> Figure:
    return draw_learning(
        {
            "SHRED, unseen simulations": analysis.learned.curves["rmse/field_members"],
            "DA-SHRED, fitted": analysis.found.curves["rmse/sensors_fit"],
            "DA-SHRED, validation": analysis.found.curves["rmse/sensors_validate"],
            "corrected SHRED": analysis.relearned.curves["rmse/field_members"],
        }
    )


def _evidence(analysis: Analysis, findings: Findings) -> Figure:
    found = analysis.discovered
    path = [(len(best.candidates), best.score) for best in found.path]
    return evidence_figure(path, findings["terms"] or [], found.on_path)


def _fields(problem: Problem, analysis: Analysis) -> Figure:
    estimates = analysis.estimates(len(problem.split.fit.times))
    return draw_fields(problem, {name: x for name, x in estimates.items() if name in PANELS})
