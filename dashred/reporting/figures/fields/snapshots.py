"""Snapshots of fields with two axes: one field and time per row, one method per column."""

from collections.abc import Mapping, Sequence

import numpy as np
from jaxtyping import Float
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from dashred.core.findings.methods import method_label
from dashred.core.units import NO_UNITS, TIME, label_with_unit, with_unit
from dashred.reporting.figures.fields.cells import (
    Extent,
    frame_points,
    image_extent,
    scale_reference,
)
from dashred.reporting.figures.style import new_figure, style

Field = Float[np.ndarray, "time x y"]

# Times of the snapshots, as fractions of the fit window.
FRACTIONS = (0.1, 0.5, 1.0)


def snapshot_panels(
    times: Float[np.ndarray, " time"],
    coordinates: Mapping[str, Float[np.ndarray, " point"]],
    fields: Mapping[str, Mapping[str, Field]],
    sensors: Mapping[str, Sequence[tuple[float, ...]]],
    units: Mapping[str, str] = NO_UNITS,
) -> Figure:
    """Draw each field at three times for each method, with one colour scale per row.

    If there is a method `truth`, the panels of the others show their error at that time, in units
    of the standard deviation of the true field.

    Args:
        times: times of the values.
        coordinates: coordinates of the two axes, by name.
        fields: values by field and method.
        sensors: positions of the sensors of each field.
        units: units of fields, axes, and of time as `t`.
    """
    shown = [round(share * (len(times) - 1)) for share in FRACTIONS]
    rows = [(field, index) for field in fields for index in shown]
    columns = list(dict.fromkeys(method for kinds in fields.values() for method in kinds))
    (x_name, x), (y_name, y) = coordinates.items()
    frame = image_extent(x, y)
    with style():
        figure = new_figure(1.3 + 2.05 * len(columns), 0.7 + 2.0 * len(rows))
        grid = figure.subplots(len(rows), len(columns), sharex=True, sharey=True, squeeze=False)
        for line, (field, index) in zip(grid, rows, strict=True):
            label = label_with_unit(field, units.get(field))
            _draw_row(figure, line, fields[field], columns, index, frame, label)
            moment = with_unit(f"{times[index]:.4g}", units.get(TIME))
            line[0].set_ylabel(f"t = {moment}\n{label_with_unit(y_name, units.get(y_name))}")
            _mark(line[0], sensors.get(field, ()))
        frame_points(grid[0, 0], x, y)
        for axes, method in zip(grid[0], columns, strict=True):
            below = axes.get_title(loc="left")
            axes.set_title("\n".join(filter(None, [method_label(method), below])), fontsize=9)
        for axes in grid[-1]:
            axes.set_xlabel(label_with_unit(x_name, units.get(x_name)))
    return figure


def _draw_row(
    figure: Figure,
    line: np.ndarray,
    kinds: Mapping[str, Field],
    columns: Sequence[str],
    index: int,
    frame: Extent,
    label: str,
) -> None:
    low, high = np.nanpercentile(scale_reference(kinds)[index], (0.2, 99.8))
    middle = (low + high) / 2
    half = max((high - low) / 2, 1e-12)
    for axes, method in zip(line, columns, strict=True):
        axes.grid(False)
        image = axes.imshow(
            kinds[method][index].T,
            origin="lower",
            extent=frame,
            vmin=middle - half,
            vmax=middle + half,
            interpolation="nearest",
        )
        if method != "truth" and "truth" in kinds:
            error = kinds[method][index] - kinds["truth"][index]
            rmse = np.sqrt(np.nanmean(error**2)) / (np.nanstd(kinds["truth"]) or 1.0)
            axes.set_title(f"error {rmse:.2g} std", fontsize=8, color="#4d4d4d")
    figure.colorbar(image, ax=line.tolist(), label=label, extend="both", pad=0.01, aspect=16)


def _mark(axes: Axes, places: Sequence[tuple[float, ...]]) -> None:
    """Mark the positions of sensors."""
    if places:
        x, y = zip(*places, strict=True)
        axes.plot(x, y, "o", markersize=3.2, color="white", markeredgecolor="black", linewidth=0)
