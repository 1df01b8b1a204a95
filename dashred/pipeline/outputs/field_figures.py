"""Figures of the fields in space: by method, where the law acts, and the free forcing."""

from __future__ import annotations

from collections.abc import Mapping

import torch
from matplotlib.figure import Figure
from torch import Tensor

from dashred.core.findings.law_schema import Forcing, LocalisedSource, Where
from dashred.core.units import label_with_unit, time_label
from dashred.inference.results.location import law_tendency
from dashred.pipeline.analysis import Analysis
from dashred.pipeline.problem import Problem
from dashred.reporting.figures.save import (
    LawMap,
    forcing_figure,
    snapshot_panels,
    space_time_panels,
    where_figure,
)


def draw_fields(problem: Problem, by_method: Mapping[str, Tensor]) -> Figure:
    """Draw the fields over the fit window: over x and t, or in the plane at three times.

    Args:
        problem: problem with axes in space.
        by_method: fields by method, ``(time, field, *grid)``, over at least the fit window.
    """
    system, fit = problem.system, problem.split.fit
    count = len(fit.times)
    fields = {
        field: {
            name: system.grid.picture(states[:count, i])[1].numpy()
            for name, states in by_method.items()
        }
        for i, field in enumerate(system.fields)
    }
    places = {
        field: [s.position for s in fit.sensors if s.reads == field] for field in system.fields
    }
    lines, _ = system.grid.picture(torch.zeros(system.grid.shape, dtype=torch.float64))
    coordinates = {name: x.numpy() for name, x in lines.items()}
    times, units = problem.times[:count].numpy(), system.units
    if len(system.axes) > 1:
        return snapshot_panels(times, coordinates, fields, places, units)
    [axis], meanings = system.axes, system.config.fields
    return space_time_panels(
        times,
        label_with_unit(axis.name, units.get(axis.name)),
        coordinates[axis.name],
        fields,
        {field: [x for (x,) in positions] for field, positions in places.items()},
        labels={f: _field_label(f, meaning, units.get(f)) for f, meaning in meanings.items()},
        clock=time_label(units),
    )


def _field_label(field: str, meaning: str, unit: str | None) -> str:
    """Return the name of a field with its meaning, if that is another word, and its unit."""
    named = label_with_unit(meaning, unit)
    return named if meaning == field else f"{field}\n{named}"


def draw_where(problem: Problem, analysis: Analysis, where: Where) -> Figure:
    """Draw where and when the law acts, and which sensors it affects."""
    system, fit = problem.system, problem.split.fit
    if len(system.axes) != 1:
        return where_figure(where, None, system.units)
    [axis], count = system.axes, len(fit.times)
    states = analysis.trajectories.states["corrected"][:count]
    tendency = law_tendency(system, analysis.discovery.best, states, problem.times[:count])
    coordinates, strength = system.grid.picture(tendency.square().sum(dim=1).sqrt())
    law_map = LawMap(
        axis.name,
        coordinates[axis.name].numpy(),
        problem.times[:count].numpy(),
        strength.numpy(),
        {sensor.name: sensor.position[0] for sensor in fit.sensors},
    )
    return where_figure(where, law_map, system.units)


def draw_forcing(problem: Problem, forcing: Forcing, source: LocalisedSource | None) -> Figure:
    """Draw the map of a free forcing over time and the only axis, and a localised source."""
    [axis], units = problem.system.axes, problem.system.units
    places = [sensor.position[0] for sensor in problem.split.fit.sensors]
    label = label_with_unit(axis.name, units.get(axis.name))
    span = axis.begin, axis.begin + axis.length
    return forcing_figure(forcing, label, span, places, time_label(units), source)
