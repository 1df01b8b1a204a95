"""Forecasts of the corrected and the uncorrected simulator after the recording."""

from collections.abc import Mapping, Sequence

import numpy as np
from jaxtyping import Float
from matplotlib.figure import Figure

from dashred.core.units import NO_UNITS, label_with_unit
from dashred.reporting.figures.held_out import frame_recorded
from dashred.reporting.figures.style import GREY, legend_above, new_figure, style
from dashred.reporting.figures.traces import draw_sensor

MAX_SENSORS = 3
# Duration of the recording that is shown, relative to that of the forecast.
SHOWN_RECORDING = 0.5

Traces = Float[np.ndarray, "time sensor"]


def forecast_figure(
    times: Float[np.ndarray, " time"],
    recorded: Traces,
    names: Sequence[str],
    traces: Mapping[str, Traces],
    units: Mapping[str, str] = NO_UNITS,
    clock: str = "time",
) -> Figure:
    """Plot up to three sensors over the end of the recording and the forecast.

    Args:
        times: times of the recording and the forecast.
        recorded: readings at the times of the recording, NaN where missing, ``(time, sensor)``.
        names: names of the sensors.
        traces: predicted readings at all times, by method.
        units: units of the readings, by sensor.
        clock: label of the time axis.
    """
    last = len(recorded) - 1
    begin = max(0, last - round(SHOWN_RECORDING * (len(times) - last)))
    shown = min(len(names), MAX_SENSORS)
    with style():
        figure = new_figure(9.6, 0.9 + 1.75 * shown)
        column = figure.subplots(shown, 1, sharex=True, squeeze=False)[:, 0]
        for index, axes in enumerate(column):
            read = np.full(len(times), np.nan)
            read[: last + 1] = recorded[:, index]
            cut = {method: trace[begin:, index] for method, trace in traces.items()}
            draw_sensor(axes, times[begin:], read[begin:], cut)
            frame_recorded(axes, recorded[:, index])
            axes.axvspan(times[last], times[-1], color="#f2f2f2", linewidth=0, zorder=0)
            axes.axvline(times[last], color=GREY, linewidth=0.8, linestyle=(0, (2, 2)), zorder=1)
            axes.set_title(names[index], fontsize=9, fontweight="bold")
            label = label_with_unit("reading", units.get(names[index]))
            axes.set(ylabel=label, xlim=(times[begin], times[-1]))
        column[0].set_title("shaded: after the recording", loc="right", fontsize=8)
        column[-1].set_xlabel(clock)
        legend_above(figure, column[0])
    return figure
