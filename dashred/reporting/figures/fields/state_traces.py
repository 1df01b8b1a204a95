"""The state of a system without space against time, by method."""

from collections.abc import Mapping

import numpy as np
from jaxtyping import Float
from matplotlib.figure import Figure

from dashred.core.findings.methods import method_label
from dashred.core.units import NO_UNITS, label_with_unit, time_label
from dashred.reporting.figures.style import legend_above, method_look, new_figure, style

# The error axis begins at this share of the truth's standard deviation.
SMALLEST = 1e-5

Trace = Float[np.ndarray, " time"]


def state_traces(
    times: Float[np.ndarray, " time"],
    fields: Mapping[str, Mapping[str, Trace]],
    meanings: Mapping[str, str],
    units: Mapping[str, str] = NO_UNITS,
) -> Figure:
    """Draw each field against time, one line a method, and below it the errors against `truth`.

    `fields` maps field to method to values, `truth` among them; `meanings` tells what a field is,
    `units` in what it is measured, and time as `t`.
    """
    with style():
        figure = new_figure(8.6, 0.6 + 2.6 * len(fields))
        grid = figure.subplots(
            2 * len(fields), 1, sharex=True, height_ratios=(1.6, 1) * len(fields)
        )
        for index, (field, kinds) in enumerate(fields.items()):
            values, errors = grid[2 * index], grid[2 * index + 1]
            for place, (method, trace) in enumerate(kinds.items()):
                look = method_look(method, place)
                values.plot(times, trace, label=method_label(method), **look)
                if method != "truth":
                    errors.semilogy(times, np.abs(trace - kinds["truth"]), **look)
            errors.set_ylim(bottom=SMALLEST * (np.std(kinds["truth"]) or 1.0))
            named = label_with_unit(field, units.get(field))
            values.set_ylabel(f"{named}\n{meanings[field]}" if field in meanings else named)
            errors.set_ylabel("error")
        legend_above(figure, grid[0])
        grid[-1].set_xlabel(time_label(units))
        grid[-1].set_xlim(times[0], times[-1])
    return figure
