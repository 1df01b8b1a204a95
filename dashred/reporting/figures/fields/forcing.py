"""Map of a free forcing: amplitude by place and time, and its uncertainty."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import LinearSegmentedColormap
from matplotlib.figure import Figure
from matplotlib.image import AxesImage

from dashred.reporting.figures.fields.space_time import mark_sensors
from dashred.reporting.figures.style import BLUE, GREY, VERMILION, new_figure, style

# Cells within this number of standard deviations of zero are dotted.
SIGNIFICANCE = 2.0
SIGNED = LinearSegmentedColormap.from_list(
    "signed", ["#08306b", BLUE, "#ffffff", VERMILION, "#4a1500"]
)
TITLE = "Free forcing added to the simulation"
LEGEND = (
    f"dotted: within {SIGNIFICANCE:g} standard deviations of zero; "
    "the laws identify the equation better"
)

Span = tuple[float, float]


def forcing_figure(
    forcing: Mapping[str, Any],
    axis: str,
    span: Span,
    sensors: Sequence[float],
    clock: str = "time",
    source: Mapping[str, Any] | None = None,
) -> Figure:
    """Draw ``findings["where"]["forcing"]`` of a system with one axis, one panel per equation.

    A localised source is marked in the panel of its equation, and its course is drawn below.

    Args:
        forcing: the forcing in the findings.
        axis: label of the coordinate.
        span: beginning and end of the axis.
        sensors: positions of the fit sensors, marked at the left edge.
        clock: label of the time axis.
        source: ``findings["where"]["source"]``; None without one.
    """
    result = {
        field: np.asarray(values, float)
        for field, values in forcing["amplitude"].items()
        if np.any(np.abs(values) > SIGNIFICANCE * np.asarray(forcing["std"][field], float))
    }
    shown = result or {f: np.asarray(v, float) for f, v in forcing["amplitude"].items()}
    limit = max(float(np.abs(values).max()) for values in shown.values()) or 1.0
    times = np.asarray(forcing["times"], float)
    with style():
        rows = len(shown) + (source is not None)
        figure = new_figure(7.4, 0.9 + 2.1 * rows)
        grid = figure.subplots(rows, 1, sharex=True, squeeze=False)[:, 0]
        for axes, (field, values) in zip(grid[: len(shown)], shown.items(), strict=True):
            std = np.asarray(forcing["std"][field], float)
            image = _draw(axes, times, span, values, limit)
            _mark_cells(axes, times, span, np.abs(values) < SIGNIFICANCE * std)
            mark_sensors(axes, sensors)
            axes.set_ylabel(axis)
            axes.set_title(f"equation of {field}", fontsize=9)
            figure.colorbar(image, ax=axes, label="fraction of its\ntendency", pad=0.015, aspect=14)
            if source is not None and source["equation"] == field:
                _mark_source(axes, source)
        if source is not None:
            _draw_course(grid[-1], source)
        grid[-1].set_xlabel(clock)
        figure.suptitle(f"{TITLE}\n{LEGEND}", x=0.01, ha="left", fontsize=10)
    return figure


def _draw(axes: Axes, times: np.ndarray, span: Span, values: np.ndarray, limit: float) -> AxesImage:
    axes.grid(False)
    half = (times[1] - times[0]) / 2
    image = axes.imshow(
        values,
        origin="lower",
        aspect="auto",
        extent=(times[0] - half, times[-1] + half, *span),
        cmap=SIGNED,
        vmin=-limit,
        vmax=limit,
        interpolation="nearest",
    )
    axes.set_xlim(times[0], times[-1])
    return image


def _mark_source(axes: Axes, source: Mapping[str, Any]) -> None:
    """Mark the peak and the region of a source on the only axis."""
    [region], [place] = source["region"], source["place"]
    axes.axhline(place, color=GREY, linewidth=1.2)
    for edge in (region["from"], region["to"]):
        axes.axhline(edge, color=GREY, linewidth=0.9, linestyle="--")


def _draw_course(axes: Axes, source: Mapping[str, Any]) -> None:
    """Draw the strength of a source over time."""
    axes.plot(source["times"], source["rates"], color=VERMILION)
    axes.axhline(0.0, color=GREY, linewidth=0.8)
    axes.set_ylabel("strength")
    title = f"localised source in the equation of {source['equation']}, integrated over space"
    axes.set_title(title, fontsize=9)


def _mark_cells(axes: Axes, times: np.ndarray, span: Span, insignificant: np.ndarray) -> None:
    """Mark cells with dots."""
    cells, knots = np.nonzero(insignificant)
    begin, end = span
    places = begin + (cells + 0.5) * (end - begin) / len(insignificant)
    axes.plot(times[knots], places, ".", color="#7a7a7a", markersize=2.5, linewidth=0)
