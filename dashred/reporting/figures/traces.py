"""Sensor traces: recorded readings and predictions of each method."""

from collections.abc import Mapping, Sequence

import numpy as np
from jaxtyping import Bool, Float
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from dashred.core.findings.methods import method_label
from dashred.core.units import NO_UNITS, label_with_unit
from dashred.reporting.figures.style import (
    BLACK,
    legend_above,
    method_style,
    new_figure,
    shade_held_out,
    style,
)

MAX_SENSORS = 6
# Up to MAX_DETAILED sensors with at least DENSE samples have a second panel with a detail.
MAX_DETAILED, DENSE = 2, 1000
ROLES = {
    "test": "test sensor",
    "validate": "validation sensor",
    "extra": "fit sensor, not SHRED's input",
    "input": "fit sensor, SHRED's input",
}

Traces = Float[np.ndarray, "time sensor"]


def sensor_traces(
    times: Float[np.ndarray, " time"],
    recorded: Traces,
    names: Sequence[str],
    roles: Mapping[str, str],
    estimates: Mapping[str, Traces],
    time_end: float,
    units: Mapping[str, str] = NO_UNITS,
    clock: str = "time",
) -> Figure:
    """Plot up to six sensors, held-out sensors first; recorded values are dots.

    Sensors without any reading are left out, if there are others.

    Args:
        times: times of the recording.
        recorded: readings, NaN where missing, ``(time, sensor)``.
        names: names of the sensors.
        roles: `test`, `validate`, `extra` or `input`, by sensor.
        estimates: predicted readings by method, ``(time, sensor)``.
        time_end: end of the fit window.
        units: units of the readings, by sensor.
        clock: label of the time axis.
    """
    has_readings = ~np.isnan(recorded).all(axis=0)
    shown = _choose(names, roles, has_readings if has_readings.any() else ~has_readings)
    panels = _panels(shown, times, time_end)
    columns = 1 if len(panels) == 1 else 2
    rows = -(-len(panels) // columns)
    with style():
        figure = new_figure(5.0 * columns, 0.8 + 1.75 * rows)
        grid = figure.subplots(rows, columns, squeeze=False)
        for axes, (sensor, window) in zip(grid.flat, panels, strict=False):
            in_window = (times >= window[0]) & (times <= window[1])
            cut = {method: traces[in_window, sensor] for method, traces in estimates.items()}
            draw_sensor(axes, times[in_window], recorded[in_window, sensor], cut)
            shade_held_out(axes, time_end, window[1], label=False)
            role = roles.get(names[sensor], "")
            whole = window == (times[0], times[-1])
            axes.set_title(names[sensor], fontsize=9, fontweight="bold")
            note = ROLES.get(role, role) if whole else "detail"
            axes.set_title(note, fontsize=8, loc="right", color="#4d4d4d")
            axes.set(ylabel=label_with_unit("reading", units.get(names[sensor])), xlim=window)
        for axes in list(grid.flat)[len(panels) :]:
            axes.set_axis_off()
        for column in grid.T:
            [axes for axes in column if axes.axison][-1].set_xlabel(clock)
        _add_legend(figure, grid[0, 0], len(shown), len(names), bool(time_end < times[-1]))
    return figure


def _panels(
    shown: Sequence[int], times: Float[np.ndarray, " time"], time_end: float
) -> list[tuple[int, tuple[float, float]]]:
    """Return the sensor and the time window of each panel."""
    whole = (float(times[0]), float(times[-1]))
    if len(shown) > MAX_DETAILED or len(times) < DENSE:
        return [(sensor, whole) for sensor in shown]
    # A long recording appears as a solid band: also show a detail at the end of the fit window.
    half = 0.05 * (whole[1] - whole[0])
    detail = (max(whole[0], time_end - half), min(whole[1], time_end + half))
    return [(sensor, window) for sensor in shown for window in (whole, detail)]


def draw_sensor(
    axes: Axes,
    times: Float[np.ndarray, " time"],
    values: Float[np.ndarray, " time"],
    estimates: Mapping[str, Float[np.ndarray, " time"]],
) -> None:
    """Draw the recorded readings of one sensor as dots, and the predicted readings as lines."""
    # With many samples, dots and lines are thinner, so that they do not hide each other.
    size = float(np.clip(24 / np.sqrt(max(len(times), 1) / 10), 1.6, 7))
    axes.plot(times, values, ".", color=BLACK, markersize=size, alpha=0.45, label="recorded")
    thin = {} if len(times) < DENSE else {"linestyle": "-", "linewidth": 0.7}
    for index, (method, trace) in enumerate(estimates.items()):
        line_style = method_style(method, index) | thin
        axes.plot(times, trace, label=method_label(method), **line_style)


def _choose(
    names: Sequence[str], roles: Mapping[str, str], possible: Bool[np.ndarray, " sensor"]
) -> list[int]:
    rank = {role: index for index, role in enumerate(ROLES)}
    every = map(int, np.flatnonzero(possible))
    order = sorted(every, key=lambda i: (rank.get(roles.get(names[i], ""), 9), i))
    held_out = [i for i in order if roles.get(names[i]) in ("test", "validate")]
    fitted = [i for i in order if i not in held_out]
    # At least two fitted sensors are shown, because their fit can be bad, too.
    shown = held_out[: max(MAX_SENSORS - 2, MAX_SENSORS - len(fitted))]
    return shown + fitted[: MAX_SENSORS - len(shown)]


def _add_legend(figure: Figure, axes: Axes, shown: int, total: int, held_out: bool) -> None:
    legend_above(figure, axes)
    parts = [f"{shown} of {total} sensors"] if shown < total else []
    if held_out:
        parts.append("shaded: held-out time")
    if parts:
        figure.supxlabel("    ".join(parts), fontsize=8, color="#5a5a5a", x=0.01, ha="left")
