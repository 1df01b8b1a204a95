"""The state of a system without axes against time, by method."""

from collections.abc import Mapping

import numpy as np
from jaxtyping import Float
from matplotlib.figure import Figure

from dashred.core.findings.methods import method_label
from dashred.core.units import NO_UNITS, label_with_unit, time_label
from dashred.reporting.figures.style import legend_above, method_style, new_figure, style

# Lower limit of the error axis, relative to the standard deviation of the truth.
MIN_ERROR = 1e-5

Trace = Float[np.ndarray, " time"]


def state_traces(
    times: Float[np.ndarray, " time"],
    fields: Mapping[str, Mapping[str, Trace]],
    units: Mapping[str, str] = NO_UNITS,
) -> Figure:
    """Plot each field against time, one line per method, and below it the errors.

    Args:
        times: times of the values.
        fields: values by field and method, with `truth` among the methods.
        units: units of the fields, and of time as `t`.
    """
    with style():
        figure = new_figure(8.6, 0.6 + 2.6 * len(fields))
        grid = figure.subplots(
            2 * len(fields), 1, sharex=True, height_ratios=(1.6, 1) * len(fields)
        )
        for index, (field, kinds) in enumerate(fields.items()):
            values, errors = grid[2 * index], grid[2 * index + 1]
            for place, (method, trace) in enumerate(kinds.items()):
                line_style = method_style(method, place)
                values.plot(times, trace, label=method_label(method), **line_style)
                if method != "truth":
                    errors.semilogy(times, np.abs(trace - kinds["truth"]), **line_style)
            errors.set_ylim(bottom=MIN_ERROR * (np.std(kinds["truth"]) or 1.0))
            values.set_ylabel(label_with_unit(field, units.get(field)))
            errors.set_ylabel("error")
        legend_above(figure, grid[0])
        grid[-1].set_xlabel(time_label(units))
        grid[-1].set_xlim(times[0], times[-1])
    return figure
