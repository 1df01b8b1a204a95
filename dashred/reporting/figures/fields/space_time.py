"""Space-time panels: values and errors of each field in rows, methods in columns."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from jaxtyping import Float
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.image import AxesImage

from dashred.core.findings.methods import method_label
from dashred.reporting.figures.fields.cells import (
    Extent,
    frame_points,
    image_extent,
    scale_reference,
)
from dashred.reporting.figures.style import GREY, new_figure, style

Field = Float[np.ndarray, "time x"]

NOTE: dict[str, Any] = {"fontsize": 8, "color": "#5a5a5a"}
ERROR_NOTE = (
    "error = method \N{MINUS SIGN} truth,\nits RMSE in units of the\nstandard deviation of truth"
)


def space_time_panels(
    times: Float[np.ndarray, " time"],
    axis_name: str,
    x: Float[np.ndarray, " x"],
    fields: Mapping[str, Mapping[str, Field]],
    sensors: Mapping[str, Sequence[float]],
    *,
    labels: Mapping[str, str] | None = None,
    time_end: float | None = None,
    clock: str = "time",
) -> Figure:
    """Draw each field against time and space for each method, with one colour scale per field.

    If there is a method `truth`, a second row shows the errors of the others, with the RMSE in
    units of the standard deviation of the true field.

    Args:
        times: times of the values.
        axis_name: label of the spatial axis.
        x: positions.
        fields: values by field and method.
        sensors: positions of the sensors of each field, marked at the left edge.
        labels: label of each field; by default its name.
        time_end: end of the fit window, marked by a dashed line.
        clock: label of the time axis.
    """
    labels = labels or {}
    columns = list(dict.fromkeys(method for kinds in fields.values() for method in kinds))
    with_error = any("truth" in kinds and len(kinds) > 1 for kinds in fields.values())
    rows = len(fields) * (2 if with_error else 1)
    with style():
        figure = new_figure(1.2 + 2.35 * len(columns), 0.9 + 1.75 * rows)
        grid = figure.subplots(rows, len(columns), sharex=True, sharey=True, squeeze=False)
        frame = image_extent(times, x)
        for index, (field, kinds) in enumerate(fields.items()):
            top = index * (2 if with_error else 1)
            _draw_values(figure, grid[top], kinds, columns, frame, labels.get(field, field))
            if with_error:
                _draw_errors(figure, grid[top + 1], kinds, columns, frame, field)
            for axes in grid[top]:
                mark_sensors(axes, sensors.get(field, ()))
                _mark_end(axes, time_end, "white")
            for axes in grid[top + 1 : top + 1 + with_error].flat:
                _mark_end(axes, time_end, GREY)
        frame_points(grid[0, 0], times, x)
        for axes, method in zip(grid[0], columns, strict=True):
            axes.set_title(method_label(method))
        if with_error and columns[0] == "truth":
            cell = grid[1, 0]
            cell.text(0.5, 0.5, ERROR_NOTE, transform=cell.transAxes, ha="center", **NOTE)
        _label_axes(grid, axis_name, clock)
        _add_note(figure, bool(any(sensors.values())), time_end)
    return figure


def _draw_values(
    figure: Figure,
    row: np.ndarray,
    kinds: Mapping[str, Field],
    columns: Sequence[str],
    frame: Extent,
    label: str,
) -> None:
    limits = tuple(np.nanpercentile(scale_reference(kinds), (0.2, 99.8)))
    if not limits[1] > limits[0]:
        limits = (limits[0] - 0.5, limits[0] + 0.5)
    for axes, method in zip(row, columns, strict=True):
        if method not in kinds:
            axes.set_axis_off()
            continue
        image = _draw(axes, kinds[method], frame, "viridis", limits)
    extend = _extend(kinds, limits)
    figure.colorbar(image, ax=row.tolist(), label=label, extend=extend, pad=0.01, aspect=14)


def _draw_errors(
    figure: Figure,
    row: np.ndarray,
    kinds: Mapping[str, Field],
    columns: Sequence[str],
    frame: Extent,
    field: str,
) -> None:
    truth = kinds.get("truth")
    errors = {} if truth is None else {m: kinds[m] - truth for m in kinds if m != "truth"}
    for axes, method in zip(row, columns, strict=True):
        if method not in errors:
            axes.set_axis_off()
    if truth is None or not errors:
        return
    magnitudes = np.concatenate([np.abs(error).ravel() for error in errors.values()])
    limit = float(np.nanpercentile(magnitudes, 99)) or 1.0
    limits = (-limit, limit)
    for axes, method in zip(row, columns, strict=True):
        if method not in errors:
            continue
        image = _draw(axes, errors[method], frame, "RdBu_r", limits)
        rmse = np.sqrt(np.nanmean(errors[method] ** 2)) / (np.nanstd(truth) or 1.0)
        axes.set_title(f"error {rmse:.2g} std", fontsize=8, color="#4d4d4d")
    extend = _extend(errors, limits)
    label = f"{field} \N{MINUS SIGN} truth"
    figure.colorbar(image, ax=row.tolist(), label=label, extend=extend, pad=0.01, aspect=14)


def _draw(
    axes: Axes,
    values: Field,
    frame: Extent,
    colours: str,
    limits: tuple[float, ...],
) -> AxesImage:
    axes.grid(False)
    return axes.imshow(
        values.T,
        origin="lower",
        aspect="auto",
        extent=frame,
        cmap=colours,
        vmin=limits[0],
        vmax=limits[1],
        interpolation="nearest",
    )


def _extend(kinds: Mapping[str, Field], limits: tuple[float, ...]) -> str:
    low = any(np.nanmin(values) < limits[0] for values in kinds.values())
    high = any(np.nanmax(values) > limits[1] for values in kinds.values())
    return {(True, True): "both", (True, False): "min", (False, True): "max"}.get(
        (low, high), "neither"
    )


def mark_sensors(axes: Axes, positions: Sequence[float]) -> None:
    """Mark the positions of sensors at the left edge of a map."""
    if not axes.axison:
        return
    axes.scatter(
        np.zeros(len(positions)),
        positions,
        marker=">",
        s=16,
        color="white",
        edgecolor="black",
        linewidth=0.6,
        transform=axes.get_yaxis_transform(),
        clip_on=False,
        zorder=5,
    )


def _mark_end(axes: Axes, time_end: float | None, colour: str) -> None:
    if time_end is not None and axes.axison:
        axes.axvline(time_end, color=colour, linewidth=1.1, linestyle=(0, (3, 2)))


def _label_axes(grid: np.ndarray, axis_name: str, clock: str) -> None:
    for axes in grid[-1]:
        axes.set_xlabel(clock)
    for axes in grid[:, 0]:
        axes.set_ylabel(axis_name)


def _add_note(figure: Figure, sensors: bool, time_end: float | None) -> None:
    parts = ["▷ sensors"] if sensors else []
    if time_end is not None:
        parts.append("dashed: end of the fit window")
    figure.supxlabel("    ".join(parts), x=0.01, ha="left", **NOTE)
