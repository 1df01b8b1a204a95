"""Coefficients of latent SINDy by epoch."""

from collections.abc import Mapping, Sequence

import numpy as np
from jaxtyping import Float, Int
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from dashred.core.formatting import plural, pretty
from dashred.reporting.figures.style import CYCLE, GREY, LIGHT, new_figure, style

LABEL_GAP = 0.075  # minimum distance of two labels, as a fraction of the panel's height


def coefficients_against_epoch(
    epochs: Int[np.ndarray, " epoch"],
    panels: Mapping[str, Mapping[str, Float[np.ndarray, " epoch"]]],
    title: str,
    top: int = 8,
) -> Figure:
    """Plot the coefficients against the epoch, one panel per algorithm.

    Args:
        epochs: epochs, ``(epoch,)``.
        panels: by algorithm, the coefficients of each term, such as ``u: u**3``.
        title: of the figure.
        top: number of terms with a label, those with the largest final coefficients. The other
            terms are grey.
    """
    with style():
        figure = new_figure(0.6 + 5.0 * max(1, len(panels)), 3.7)
        figure.suptitle(title, x=0.01, ha="left")
        grid = figure.subplots(1, max(1, len(panels)), squeeze=False)[0]
        for axes, (name, coefficients) in zip(grid, panels.items(), strict=False):
            axes.axhline(0, color=GREY, linewidth=0.8)
            _draw_panel(axes, np.asarray(epochs), coefficients, top)
            axes.set(title=name, xlabel="epoch")
        grid[0].set_ylabel("coefficient")
    return figure


def _draw_panel(
    axes: Axes,
    epochs: Int[np.ndarray, " epoch"],
    coefficients: Mapping[str, Float[np.ndarray, " epoch"]],
    top: int,
) -> None:
    last = {label: _last_finite(values) for label, values in coefficients.items()}
    order = sorted(last, key=lambda label: (-abs(last[label]), label))
    named = [label for label in order[:top] if last[label] != 0]
    for label in order[::-1]:
        if label not in named:
            axes.plot(epochs, coefficients[label], color=LIGHT, linewidth=1)
    for label, colour in zip(named, _colours(len(named)), strict=True):
        axes.plot(epochs, coefficients[label], color=colour)
    axes.set_xlim(epochs[0], max(epochs[-1], epochs[0] + 1))
    axes.margins(y=0.08)
    axes.autoscale_view()
    others = len(order) - len(named)
    if others:
        _add_corner_note(axes, f"grey: {plural(others, 'other term')}")
    if not order:
        _add_corner_note(axes, "no term proposed at any epoch")
    _label_ends(axes, named, [last[label] for label in named])


def _label_ends(axes: Axes, labels: Sequence[str], ends: Sequence[float]) -> None:
    low, high = axes.get_ylim()
    wanted = [(end - low) / (high - low) for end in ends]
    for label, end, colour, y, at in zip(
        labels, ends, _colours(len(labels)), spread_out(wanted, LABEL_GAP), wanted, strict=True
    ):
        axes.annotate(
            f"{pretty(label)}   {end:+.3g}".replace("-", "\N{MINUS SIGN}"),
            (1, at),
            xytext=(1.04, y),
            xycoords="axes fraction",
            textcoords="axes fraction",
            va="center",
            fontsize=8,
            color=colour,
            arrowprops={"arrowstyle": "-", "color": colour, "linewidth": 0.7, "shrinkA": 1},
        )


def spread_out(wanted: Sequence[float], gap: float) -> list[float]:
    """Return the heights nearest to `wanted`, in the same order and at least `gap` apart.

    The method is isotonic regression (pool adjacent violators) of the heights minus their minimum
    spacing. The result is limited to [0, 1] if it fits.
    """
    order = np.argsort(wanted, kind="stable")
    blocks: list[list[float]] = []
    for rank, index in enumerate(order):
        blocks.append([wanted[index] - rank * gap, 1.0])
        while len(blocks) > 1 and blocks[-2][0] >= blocks[-1][0]:
            (a, m), (b, n) = blocks[-2:]
            blocks[-2:] = [[(a * m + b * n) / (m + n), m + n]]
    levels = [level for level, size in blocks for _ in range(round(size))]
    room = max(0.0, 1.0 - gap * (len(levels) - 1))
    heights = [0.0] * len(levels)
    for rank, index in enumerate(order):
        heights[index] = min(max(levels[rank], 0.0), room) + rank * gap
    return heights


def _colours(count: int) -> list[str]:
    return [CYCLE[index % len(CYCLE)] for index in range(count)]


def _last_finite(values: Float[np.ndarray, " epoch"]) -> float:
    finite = np.asarray(values)[np.isfinite(values)]
    return float(finite[-1]) if finite.size else 0.0


def _add_corner_note(axes: Axes, text: str) -> None:
    axes.annotate(
        text,
        (1, 0),
        xycoords="axes fraction",
        xytext=(-3, 3),
        textcoords="offset points",
        ha="right",
        va="bottom",
        fontsize=7.5,
        color="#7a7a7a",
    )
