"""The errors of faulty sensors over time."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from matplotlib.figure import Figure

from dashred.core.units import label_with_unit
from dashred.reporting.figures.style import (
    BLACK,
    VERMILION,
    legend_above,
    new_figure,
    shade_held_out,
    style,
)


@dataclass(frozen=True)
class SensorError:
    """The error of one sensor in one episode.

    Attributes:
        title: the sensor, and the episode if there are several.
        times: sample times, ``(time,)``.
        differences: recorded readings minus those of the corrected simulation, ``(time,)``.
        curve_times: times of the error curve, ``(point,)``.
        value: the error, ``(point,)``.
        std: its standard deviation, ``(point,)``.
        time_end: end of the fit window.
        unit: unit of the readings, if it is stated.
    """

    title: str
    times: Float[np.ndarray, " time"]
    differences: Float[np.ndarray, " time"]
    curve_times: Float[np.ndarray, " point"]
    value: Float[np.ndarray, " point"]
    std: Float[np.ndarray, " point"]
    time_end: float
    unit: str | None


def error_curves_figure(errors: Sequence[SensorError], clock: str = "time") -> Figure:
    """Plot the error of each sensor with a band of two standard deviations.

    Args:
        errors: one panel each.
        clock: label of the time axis.
    """
    with style():
        figure = new_figure(7.2, 0.8 + 2.2 * len(errors))
        grid = figure.subplots(len(errors), 1, squeeze=False)[:, 0]
        for axes, error in zip(grid, errors, strict=True):
            axes.plot(
                error.times,
                error.differences,
                ".",
                color=BLACK,
                markersize=3,
                alpha=0.45,
                label="recorded minus corrected simulation",
            )
            low, high = error.value - 2 * error.std, error.value + 2 * error.std
            axes.fill_between(error.curve_times, low, high, color=VERMILION, alpha=0.25, lw=0)
            axes.plot(error.curve_times, error.value, color=VERMILION, label="error of the sensor")
            axes.axhline(0.0, color=BLACK, linewidth=0.6)
            shade_held_out(axes, error.time_end, float(error.times[-1]), label=False)
            axes.set_title(error.title, fontsize=9, fontweight="bold")
            axes.set(ylabel=label_with_unit("error", error.unit))
            axes.set_xlim(error.times[0], error.times[-1])
        grid[-1].set_xlabel(clock)
        legend_above(figure, grid[0])
    return figure
