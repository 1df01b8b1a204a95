"""Common style of all figures.

The colours are those of Okabe and Ito (2008), which colour-blind readers can distinguish. A method
has the same colour and line style in all figures.
"""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import matplotlib as mpl
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.text import Text

from dashred.core.files.atomic import atomic_file
from dashred.core.findings.methods import SHRED_UNCHANGED
from dashred.reporting.figures.figure_names import SOFTWARE

BLACK, GREY, LIGHT = "#1a1a1a", "#8a8a8a", "#d9d9d9"
ORANGE, SKY, GREEN = "#e69f00", "#56b4e9", "#009e73"
BLUE, VERMILION, PURPLE = "#0072b2", "#d55e00", "#cc79a7"
CYCLE = (BLUE, VERMILION, GREEN, PURPLE, ORANGE, SKY, BLACK, GREY)

COLOURS = {
    "truth": BLACK,
    "recorded": BLACK,
    "nearest_snapshots": ORANGE,
    "simulation": ORANGE,
    "simulation_same_start": BLUE,
    "simulation_refit": GREY,
    "optimal_interpolation": BLACK,
    "closed_form": BLACK,
    "filter_state": PURPLE,
    "filter_augmented": PURPLE,
    "shred_plain": SKY,
    "pyshred": ORANGE,
    "pyshred_tuned": ORANGE,
    "shred": SKY,
    SHRED_UNCHANGED: SKY,
    "dashred": VERMILION,
    "corrected": GREEN,
    "corrected_shred": GREEN,
    "observer": PURPLE,
}
# Lines that often coincide have different widths: SHRED and DA-SHRED, and the closed form and the
# corrected simulator.
WIDTHS = {"shred": 2.4, "closed_form": 1.0}
# The truth is a thin dashed line on top, so that lines that coincide with it remain visible.
TRUTH = {"color": BLACK, "linewidth": 1.0, "linestyle": (0, (3, 3)), "zorder": 3}
DASHES = {
    "nearest_snapshots": "--",
    "simulation": "--",
    "simulation_same_start": "--",
    "simulation_refit": ":",
    "closed_form": "-.",
    "filter_augmented": "--",
    "shred_plain": ":",
    "pyshred": ":",
    "corrected_shred": "--",
    "observer": "-.",
}

# Least width of a legend entry, and the widths of its line and of a letter, in inches.
LEGEND_ENTRY_WIDTH = 2.3
LEGEND_LINE_WIDTH, LETTER_WIDTH = 0.6, 0.07

RC: dict[Any, Any] = {
    "font.family": "DejaVu Sans",
    "font.size": 9,
    "axes.titlesize": 10,
    "axes.titlelocation": "left",
    "axes.labelsize": 9,
    "axes.edgecolor": "#4d4d4d",
    "axes.linewidth": 0.7,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "axes.grid.axis": "y",
    "axes.axisbelow": True,
    "grid.color": "#e6e6e6",
    "grid.linewidth": 0.7,
    "lines.linewidth": 1.6,
    "lines.solid_capstyle": "round",
    "xtick.color": "#4d4d4d",
    "ytick.color": "#4d4d4d",
    "xtick.labelsize": 8,
    "ytick.labelsize": 8,
    "legend.frameon": False,
    "legend.fontsize": 8.5,
    "figure.titlesize": 12,
    "figure.facecolor": "white",
    "image.cmap": "viridis",
}


@contextmanager
def style() -> Iterator[None]:
    """Use the common style, independent of the user's matplotlib settings."""
    with mpl.rc_context():
        mpl.rcdefaults()
        mpl.rcParams.update(RC)
        yield


def new_figure(width: float, height: float) -> Figure:
    """Return an empty figure of a size in inches, which pyplot does not manage."""
    figure = Figure(figsize=(width, height), layout="constrained")
    FigureCanvasAgg(figure)
    return figure


def save_figure(figure: Figure, path: Path) -> None:
    """Save a figure as PNG, completely or not at all; the same figure gives the same bytes."""
    with atomic_file(path) as partial, style():
        _disable_math_text(figure)
        figure.savefig(partial, format="png", dpi=150, metadata={"Software": SOFTWARE})


def _disable_math_text(figure: Figure) -> None:
    """Show a $ in a user's name as a $; only the powers of ten of tick labels are math text."""
    powers = {
        id(label)
        for axes in figure.axes
        for axis in (axes.xaxis, axes.yaxis)
        if axis.get_scale() != "linear"
        for label in axis.get_ticklabels(which="both")
    }
    for text in figure.findobj(Text):
        if isinstance(text, Text) and id(text) not in powers:
            text.set_parse_math(False)


def method_style(method: str, index: int) -> dict[str, Any]:
    """Return the line style of a method; unknown methods use the `index`-th colour."""
    if method == "truth":
        return dict(TRUTH)
    return {
        "color": COLOURS.get(method, CYCLE[index % len(CYCLE)]),
        "linestyle": DASHES.get(method, "-"),
        "linewidth": WIDTHS.get(method, RC["lines.linewidth"]),
    }


def legend_above(figure: Figure, axes: Axes) -> None:
    """Add the legend of some axes above the figure, in as many columns as fit."""
    handles, labels = axes.get_legend_handles_labels()
    if handles:
        width = max(LEGEND_ENTRY_WIDTH, LEGEND_LINE_WIDTH + LETTER_WIDTH * max(map(len, labels)))
        columns = max(1, min(len(handles), int(figure.get_figwidth() / width)))
        figure.legend(handles, labels, loc="outside upper left", ncols=columns)


def shade_held_out(axes: Axes, time_end: float, last: float, *, label: bool) -> None:
    """Shade the time after `time_end`, which was not used for fitting."""
    if time_end >= last:
        return
    axes.axvspan(time_end, last, color="#f2f2f2", linewidth=0, zorder=0)
    axes.axvline(time_end, color=GREY, linewidth=0.8, linestyle=(0, (2, 2)), zorder=1)
    if label:
        axes.annotate(
            "held-out time",
            ((time_end + last) / 2, 1),
            xycoords=("data", "axes fraction"),
            xytext=(0, 2),
            textcoords="offset points",
            ha="center",
            fontsize=7.5,
            color="#5a5a5a",
        )
