"""The force that no law expresses, over time, of a system without axes."""

from collections.abc import Mapping
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from dashred.reporting.figures.style import BLACK, VERMILION, new_figure, style


def force_over_time(forcing: Mapping[str, Any], clock: str = "time") -> Figure:
    """Draw ``findings["where"]["forcing"]`` of a system without axes, one panel per equation.

    The band is two standard deviations wide on either side.

    Args:
        forcing: the forcing in the findings; equations without a force are left out.
        clock: label of the time axis.
    """
    times = np.asarray(forcing["times"], float)
    values = {field: np.asarray(cells[0], float) for field, cells in forcing["amplitude"].items()}
    shown = {field: value for field, value in values.items() if value.any()} or values
    with style():
        figure = new_figure(7.2, 0.8 + 2.0 * len(shown))
        grid = figure.subplots(len(shown), 1, sharex=True, squeeze=False)[:, 0]
        for axes, (field, value) in zip(grid, shown.items(), strict=True):
            std = np.asarray(forcing["std"][field][0], float)
            axes.fill_between(
                times, value - 2 * std, value + 2 * std, color=VERMILION, alpha=0.25, lw=0
            )
            axes.plot(times, value, color=VERMILION)
            axes.axhline(0.0, color=BLACK, linewidth=0.6)
            axes.set_title(f"equation of {field}", fontsize=9)
            axes.set_ylabel("fraction of its\ntendency")
            axes.set_xlim(times[0], times[-1])
        grid[-1].set_xlabel(clock)
    return figure
