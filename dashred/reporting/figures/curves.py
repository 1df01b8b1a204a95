"""Curves against time and against the epoch."""

from collections.abc import Iterable, Mapping, Sequence

import numpy as np
from jaxtyping import Float, Int
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from dashred.core.findings.methods import method_label
from dashred.reporting.figures.style import (
    CYCLE,
    legend_above,
    method_style,
    new_figure,
    shade_held_out,
    style,
)

WIDE_RANGE = 30.0  # above this ratio of values the scale is logarithmic


def rmse_against_time(
    times: Float[np.ndarray, " time"],
    curves: Mapping[str, Float[np.ndarray, " time"]],
    time_end: float,
    ylabel: str,
    clock: str = "time",
) -> Figure:
    """Plot the RMSE of each method against time; the time after `time_end` is shaded."""
    with style():
        figure = new_figure(7.2, 3.6)
        axes = figure.subplots()
        shade_held_out(axes, time_end, float(times[-1]), label=True)
        for index, (method, values) in enumerate(curves.items()):
            axes.plot(times, values, label=method_label(method), **method_style(method, index))
        axes.set(xlabel=clock, ylabel=ylabel, xlim=(times[0], times[-1]))
        _choose_scale(axes, [float(np.nanmedian(values)) for values in curves.values()])
        legend_above(figure, axes)
    return figure


def epochs_and_values(
    points: Sequence[tuple[int, float]],
) -> tuple[Int[np.ndarray, " epoch"], Float[np.ndarray, " epoch"]]:
    """Split the points of a curve into epochs and values."""
    return np.array([epoch for epoch, _ in points]), np.array([value for _, value in points])


def learning_curves(
    curves: Mapping[str, tuple[Int[np.ndarray, " epoch"], Float[np.ndarray, " epoch"]]],
    ylabel: str = "loss",
) -> Figure:
    """Plot curves against the epoch; a dot and the legend show the minimum of each."""
    with style():
        figure = new_figure(6.4, 3.4)
        axes = figure.subplots()
        for index, (name, (epochs, values)) in enumerate(curves.items()):
            colour = CYCLE[index % len(CYCLE)]
            [line] = axes.plot(epochs, values, color=colour, label=name)
            if np.isfinite(values).any():
                best = int(np.nanargmin(values))
                axes.plot(epochs[best], values[best], "o", color=colour, markersize=5)
                line.set_label(f"{name}: {values[best]:.3g} at epoch {epochs[best]}")
        axes.set(xlabel="epoch", ylabel=ylabel)
        axes.margins(y=0.15)
        _choose_scale(axes, [value for _, values in curves.values() for value in values])
        legend_above(figure, axes)
    return figure


def _choose_scale(axes: Axes, compared: Iterable[float]) -> None:
    values = np.asarray([value for value in compared if np.isfinite(value) and value > 0])
    if values.size and values.max() > WIDE_RANGE * values.min():
        axes.set_yscale("log")
    elif values.size:
        axes.set_ylim(bottom=0)
