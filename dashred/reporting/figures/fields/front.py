"""Position and width of a front against time, by method."""

from collections.abc import Mapping

import numpy as np
from jaxtyping import Float
from matplotlib.figure import Figure

from dashred.core.findings.methods import method_label
from dashred.core.units import NO_UNITS, label_with_unit, time_label
from dashred.reporting.figures.fields.front_position import follow_front
from dashred.reporting.figures.style import legend_above, method_style, new_figure, style

Field = Float[np.ndarray, "time x"]


def front_figure(
    times: Float[np.ndarray, " time"],
    kinds: Mapping[str, Field],
    axis_name: str,
    length: float,
    units: Mapping[str, str] = NO_UNITS,
) -> Figure:
    """Plot position and width of the front in a field, one line per method.

    Args:
        times: times of the samples.
        kinds: the field by method, possibly with `truth`.
        axis_name: axis along which the front moves.
        length: period of that axis.
        units: units of the axis, and of time as `t`.
    """
    with style():
        figure = new_figure(9.6, 3.4)
        left, right = figure.subplots(1, 2)
        for index, (method, values) in enumerate(kinds.items()):
            position, width = follow_front(values, length)
            line_style = method_style(method, index)
            left.plot(times, position, label=method_label(method), **line_style)
            right.plot(times, width, **line_style)
        clock, unit = time_label(units), units.get(axis_name)
        position_label = label_with_unit(f"position of the front, {axis_name} unwrapped", unit)
        left.set(xlabel=clock, ylabel=position_label)
        right.set(xlabel=clock, ylabel=label_with_unit("width of the front", unit))
        right.set_ylim(bottom=0)
        legend_above(figure, left)
    return figure
