"""Errors with and without the law on held-out data."""

import math
from collections.abc import Mapping, Sequence

import numpy as np
from jaxtyping import Float
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from dashred.core.findings.methods import method_label
from dashred.core.units import NO_UNITS, label_with_unit
from dashred.reporting.figures.style import (
    COLOURS,
    new_figure,
    shade_held_out,
    style,
)
from dashred.reporting.figures.traces import draw_sensor

MAX_SENSORS = 3
# Bars are cut off above so many standard deviations, and so many times the smallest.
MAX_BAR, MAX_RATIO = 5.0, 20.0
COMPARED = ("simulation_same_start", "simulation_refit", "corrected")
LABELS = {
    "test_sensors": "test sensors",
    "heldout_time": "held-out time",
    "heldout_restarted": "held-out,\nnew state",
    "heldout_episode": "held-out\nepisode",
}

Traces = Float[np.ndarray, "time sensor"]


def verification_figure(
    times: Float[np.ndarray, " time"],
    recorded: Traces,
    names: Sequence[str],
    traces: Mapping[str, Traces],
    time_end: float,
    errors: Mapping[str, Mapping[str, float | None]],
    units: Mapping[str, str] = NO_UNITS,
    clock: str = "time",
) -> Figure:
    """Plot up to three test sensors with and without the law, and the errors of all methods.

    Args:
        times: times of the recording.
        recorded: readings of the test sensors, NaN where missing, ``(time, sensor)``.
        names: names of the test sensors.
        traces: predicted readings by `simulation_same_start`, `simulation_refit`, `corrected`.
        time_end: end of the fit window.
        errors: `test_sensors`, `heldout_time`, `heldout_restarted` and, if it exists,
            `heldout_episode` of the findings.
        units: units of the readings, by sensor.
        clock: label of the time axis.
    """
    shown = min(len(names), MAX_SENSORS)
    with style():
        figure = new_figure(9.6 if shown else 4.6, 1.1 + 1.75 * max(shown, 1.4))
        if shown:
            left, right = figure.subfigures(
                1, 2, squeeze=False, width_ratios=(2.5, 1), wspace=0.03
            )[0]
            column = left.subplots(shown, 1, sharex=True, squeeze=False)[:, 0]
            for index, axes in enumerate(column):
                cut = {method: trace[:, index] for method, trace in traces.items()}
                draw_sensor(axes, times, recorded[:, index], cut)
                frame_recorded(axes, recorded[:, index])
                axes.set_title(names[index], fontsize=9, fontweight="bold")
                shade_held_out(axes, time_end, float(times[-1]), label=index == 0)
                label = label_with_unit("reading", units.get(names[index]))
                axes.set(ylabel=label, xlim=(times[0], times[-1]))
            column[0].set_title("test sensors, not used in any fit", loc="center", fontsize=9)
            column[-1].set_xlabel(clock)
            handles, labels = column[0].get_legend_handles_labels()
            left.legend(handles, labels, loc="outside upper left", ncols=2)
            _draw_errors(right.subplots(), errors)
        else:
            axes = figure.subplots()
            _draw_errors(axes, errors)
            handles, labels = axes.get_legend_handles_labels()
            figure.legend(handles, labels, loc="outside lower left")
    return figure


def frame_recorded(axes: Axes, values: Float[np.ndarray, " time"]) -> None:
    """Set the vertical limits from the recording, so that a diverging simulation does not."""
    finite = values[np.isfinite(values)]
    if finite.size:
        low, high = finite.min(), finite.max()
        margin = 0.6 * (high - low) or 1.0
        axes.set_ylim(low - margin, high + margin)


def _draw_errors(axes: Axes, errors: Mapping[str, Mapping[str, float | None]]) -> None:
    """Draw the errors as labelled bars, in one group for each kind of held-out data."""
    axes.grid(False)
    groups = [
        key for key in LABELS if any(errors.get(key, {}).get(m) is not None for m in COMPARED)
    ]
    values = [v for g in groups for m in COMPARED if (v := errors[g].get(m)) is not None]
    top = _bar_limit(values)
    ticks = []
    for place, group in enumerate(groups):
        for slot, method in enumerate(COMPARED):
            value = errors[group].get(method)
            if value is None:
                continue
            at, height = place + (slot - 1) * 0.27, min(value, top)
            label = None if place else method_label(method)
            axes.bar(at, height, width=0.24, color=COLOURS[method], label=label)
            text = f"{value:.2g}" if value <= top else f"↑ {value:.2g}"
            axes.text(at, height + 0.015 * top, text, ha="center", fontsize=8)
        ticks.append(LABELS[group])
    axes.set_xticks(range(len(groups)), ticks, fontsize=9)
    axes.tick_params(axis="x", length=0)
    axes.set_yticks([])
    axes.spines["left"].set_visible(False)
    axes.set_ylim(0, 1.12 * top)
    axes.set_title("RMSE / standard deviation", fontsize=9)


def _bar_limit(values: Sequence[float]) -> float:
    """Return the height at which bars are cut off, so that the small ones stay visible.

    A simulation that diverges has an error of many orders of magnitude, or an infinite one.
    """
    finite = [value for value in values if math.isfinite(value)]
    if not finite:
        return 1.0
    cut = max(MAX_BAR, MAX_RATIO * min(finite))
    return min(max(finite), cut) or 1.0
