"""Figure of the errors of all methods with a field over time: ``methods_truth.png``."""

from collections.abc import Mapping
from pathlib import Path

import numpy as np
from jaxtyping import Float
from matplotlib.figure import Figure

from dashred.core.findings.methods import SHRED_UNCHANGED, method_label
from dashred.core.units import time_label
from dashred.reporting.figures.style import method_style, new_figure, save_figure, style

METHODS_FIGURE = "methods_truth.png"
# In the order of the legend. Related methods share a colour and differ in their dashes.
PLOTTED = (
    "simulation_same_start",
    "optimal_interpolation",
    "filter_state",
    "filter_augmented",
    "shred_plain",
    "pyshred_tuned",
    "shred",
    SHRED_UNCHANGED,
    "dashred",
    "corrected",
    "corrected_shred",
    "closed_form",
)
# Limits of the axis, so that a lost or momentarily exact run does not hide the others.
LOWEST, HIGHEST = 1e-5, 30.0
# Number of windows per record. Errors of a state with few values often pass zero, so that without
# averaging the lines of all methods would cross everywhere.
WINDOWS = 25


def draw_methods(
    folder: Path,
    times: Float[np.ndarray, " time"],
    curves: Mapping[str, Float[np.ndarray, " time"]],
    units: Mapping[str, str],
) -> None:
    """Save the figure in the folder of a row.

    Args:
        folder: folder of the row.
        times: times of the samples.
        curves: RMSE at each time, by method.
        units: units by name; that of time is `t`.
    """
    save_figure(methods_figure(times, curves, time_label(units)), folder / METHODS_FIGURE)


def methods_figure(
    times: Float[np.ndarray, " time"],
    curves: Mapping[str, Float[np.ndarray, " time"]],
    clock: str = "time",
) -> Figure:
    """Draw the RMSE of each method over a moving window, in std, with gaps if it is not finite.

    Args:
        times: times of the samples.
        curves: RMSE at each time, by method.
        clock: label of the time axis.
    """
    with style():
        figure = new_figure(8.6, 3.8)
        axes = figure.subplots()
        known = {method: curves[method] for method in PLOTTED if method in curves}
        drawn = {m: moving_rms(v) for m, v in known.items()}
        seen = np.concatenate([[1.0], *(values[values > 0] for values in drawn.values())])
        axes.set(
            xlabel=clock,
            ylabel=f"field RMSE / standard deviation,\nover 1/{WINDOWS} of the record",
            xlim=(times[0], times[-1]),
            yscale="log",
            ylim=(max(seen.min() / 1.5, LOWEST), min(seen.max() * 1.5, HIGHEST)),
        )
        for index, (method, values) in enumerate(drawn.items()):
            axes.plot(times, values, label=method_label(method), **method_style(method, index))
        if drawn:
            figure.legend(loc="outside right upper")
    return figure


def moving_rms(values: Float[np.ndarray, " time"]) -> Float[np.ndarray, " time"]:
    """Return the root mean square over a window around each time, which is shorter at the ends."""
    square = np.where(np.isfinite(values), values, np.nan) ** 2
    half = len(values) // WINDOWS // 2
    parts = (square[max(0, at - half) : at + half + 1] for at in range(len(values)))
    return np.sqrt(np.array([part.mean() for part in parts]))
