"""The evidence for the law: score by number of terms, and coefficients."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from dashred.core.formatting import pretty, with_error
from dashred.core.units import with_unit
from dashred.reporting.figures.style import BLUE, GREY, VERMILION, new_figure, style

# Scores within this distance of the best are equally good.
AMBIGUOUS = 6.0
# Above this ratio of sizes, each coefficient is drawn relative to its size.
WIDE_RANGE = 20.0
NOTE: dict[str, Any] = {"fontsize": 8, "color": "#5a5a5a"}


def evidence_figure(
    path: Sequence[tuple[int, float]], terms: Sequence[Mapping[str, Any]], reported: int | None
) -> Figure:
    """Plot the score of the best law of each size, and the coefficients of the reported law.

    Args:
        path: number of terms and score of the best law of each size.
        terms: ``findings["terms"]``.
        reported: index of the reported law in the path; None if it is not in the path.
    """
    with style():
        figure = new_figure(9.6, max(3.2, 1.6 + 0.5 * len(terms)))
        left, right = figure.subplots(1, 2, width_ratios=(1, 1.15), gridspec_kw={"wspace": 0.08})
        _draw_path(left, path, terms, reported)
        _draw_coefficients(right, terms)
    return figure


def _draw_path(
    axes: Axes,
    path: Sequence[tuple[int, float]],
    terms: Sequence[Mapping[str, Any]],
    reported: int | None,
) -> None:
    sizes, scores = (np.array(part, float) for part in zip(*sorted(path), strict=True))
    above = scores - scores.min()
    axes.axhspan(0, AMBIGUOUS, color="#e8f3ee", linewidth=0, zorder=0)
    axes.plot(sizes, above, "o-", color=BLUE, markersize=5, clip_on=False)
    if reported is not None:
        size, score = path[reported]
        axes.plot(
            size,
            score - scores.min(),
            "o",
            markersize=13,
            markerfacecolor="none",
            markeredgecolor=VERMILION,
            markeredgewidth=1.6,
            clip_on=False,
        )
    names = [_name(term) for term in terms] or ["no term"]
    axes.annotate(
        "\n".join(["ring:" if reported is not None else "reported (not shown):", *names]),
        (1, 1),
        xycoords="axes fraction",
        xytext=(-4, -6),
        textcoords="offset points",
        ha="right",
        va="top",
        fontsize=9,
        color=VERMILION,
    )
    axes.set_yscale("symlog", linthresh=10, linscale=0.6)
    axes.set_ylim(bottom=0, top=max(30.0, 2.5 * above.max()))
    axes.set_xlim(sizes.min() - 0.4, sizes.max() + 0.4)
    axes.xaxis.set_major_locator(MaxNLocator(integer=True))
    axes.set(xlabel="number of terms and parameters", ylabel="ΔBIC relative to the best")
    axes.set_title("best law of each size; green: equally good", fontsize=9)


def _draw_coefficients(axes: Axes, terms: Sequence[Mapping[str, Any]]) -> None:
    axes.grid(False, axis="y")
    if not terms:
        axes.set_axis_off()
        axes.text(0.5, 0.5, "no term is added", ha="center", transform=axes.transAxes, **NOTE)
        return
    axes.grid(True, axis="x")
    values = np.array([term["coefficient"] for term in terms])
    errors = np.array([(term["ci95"][1] - term["ci95"][0]) / 2 for term in terms])
    sizes = np.abs(values)
    relative = sizes.max() > WIDE_RANGE * sizes.min()
    scale = np.where(sizes > 0, sizes, 1.0) if relative else np.ones_like(values)
    rows = np.arange(len(terms))
    colours = [VERMILION if value > 0 else BLUE for value in values]
    axes.barh(rows, values / scale, height=0.42, color=colours, alpha=0.85)
    bars: dict[str, Any] = {"fmt": "none", "ecolor": "#1a1a1a", "elinewidth": 1.2, "capsize": 3.5}
    axes.errorbar(values / scale, rows, xerr=errors / scale, **bars)
    axes.axvline(0, color=GREY, linewidth=0.8)
    for row, term in enumerate(terms):
        size = with_unit(with_error(term["coefficient"], term["std"]), term.get("unit"))
        text = f"{_name(term)}    {size}"
        axes.annotate(
            text, (0, row - 0.32), xycoords=("axes fraction", "data"), va="bottom", fontsize=8.5
        )
    axes.set_yticks([])
    axes.spines["left"].set_visible(False)
    axes.set_ylim(len(terms) - 0.5, -0.8)
    axes.margins(x=0.06)
    axes.set_xlabel("coefficient / its magnitude" if relative else "coefficient")
    axes.set_title("the law's coefficients, with 95 % intervals", fontsize=9)


def _name(term: Mapping[str, Any]) -> str:
    """Return the label of a term, such as ``u: u³`` or ``change of nu``."""
    if term["equation"] is None:
        return f"change of {term['term']}"
    return f"{term['equation']}: {pretty(term['term'])}"
