"""Where a front stands against time, and how wide it is, by method."""

from collections.abc import Mapping

import numpy as np
from jaxtyping import Float
from matplotlib.figure import Figure

from dashred.core.findings.methods import method_label
from dashred.core.units import NO_UNITS, label_with_unit, time_label
from dashred.reporting.figures.fields.front_position import follow_front
from dashred.reporting.figures.style import legend_above, method_look, new_figure, style

Field = Float[np.ndarray, "time x"]


def front_figure(
    times: Float[np.ndarray, " time"],
    kinds: Mapping[str, Field],
    axis_name: str,
    length: float,
    units: Mapping[str, str] = NO_UNITS,
) -> Figure:
    """Draw place and width of the front in a field, one line a method.

    Args:
        times: of the samples.
        kinds: the field by method; `truth` may be among them.
        axis_name: along which the front runs.
        length: of that axis, around.
        units: of the axis, and of time as `t`.
    """
    with style():
        figure = new_figure(9.6, 3.4)
        left, right = figure.subplots(1, 2)
        for index, (method, values) in enumerate(kinds.items()):
            place, width = follow_front(values, length)
            look = method_look(method, index)
            left.plot(times, place, label=method_label(method), **look)
            right.plot(times, width, **look)
        clock, unit = time_label(units), units.get(axis_name)
        place_label = label_with_unit(f"place of the front, {axis_name} counted on", unit)
        left.set(xlabel=clock, ylabel=place_label)
        right.set(xlabel=clock, ylabel=label_with_unit("width of the front", unit))
        right.set_ylim(bottom=0)
        legend_above(figure, left)
    return figure
