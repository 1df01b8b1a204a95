"""Figures of the proof: scores by kind, stated probabilities, intervals and gains."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from dashred.evaluation.proof.cases.case_record import KINDS, CaseRecord, Gain
from dashred.evaluation.proof.scoring.outcomes import deviation, leading_right
from dashred.evaluation.proof.scoring.statistics import Rate
from dashred.evaluation.proof.scoring.targets import Records, cases, coefficients, nulls, of_kind
from dashred.reporting.figures.save import save_figure
from dashred.reporting.figures.style import (
    BLACK,
    BLUE,
    GREEN,
    GREY,
    LIGHT,
    ORANGE,
    PURPLE,
    SKY,
    VERMILION,
    new_figure,
    style,
)

BINS = (0.0, 0.5, 0.7, 0.9, 0.98, 1.0)
# Height of a vertical count label, in units of the axis.
LABEL_HEIGHT = 0.15
WINDOWS: dict[str | None, tuple[str, str]] = {
    None: ("everywhere", BLUE),
    "box": ("in a region", VERMILION),
    "gate": ("gated by the state", GREEN),
    "onset": ("from an onset on", PURPLE),
}
COVERAGE_TARGET = (0.90, 0.98)  # of 95 % intervals
GAINS: dict[Gain, tuple[str, str, float]] = {
    "test_sensors": ("test sensors", BLUE, 5.0),
    "forecast": ("forecast", ORANGE, 10.0),
}


class ReliabilityBin(NamedTuple):
    """Cases with the stated probability of the leading cause in one bin."""

    low: float
    high: float
    mean: float
    right: Rate


def reliability(records: Records) -> list[ReliabilityBin]:
    """Return how often the leading cause has the true kind, binned by its stated probability."""
    pairs = [
        (record["probability"], right)
        for record in cases(records)
        if record["probability"] is not None and (right := leading_right(record)) is not None
    ]
    binned = []
    for low, high in pairwise(BINS):
        inside = [(p, right) for p, right in pairs if low < p <= high]
        if inside:
            mean = sum(p for p, _ in inside) / len(inside)
            binned.append(ReliabilityBin(low, high, mean, Rate.of(right for _, right in inside)))
    return binned


def scores_figure(records: Records) -> Figure:
    """Draw the share of right and of listed verdicts by kind, with Wilson intervals."""
    rows = {"all cases": cases(records)}
    rows |= {name: of_kind(records, kind) for kind, name in KINDS.items()}
    rows |= {"nulls, separately": nulls(records)}
    rows = {name: chosen for name, chosen in rows.items() if chosen}
    labels: tuple[str | None, str | None] = ("ambiguous, truth listed", "right, 95 % interval")
    with style():
        figure = new_figure(6.8, 1.4 + 0.32 * len(rows))
        axes = figure.subplots()
        for row, (name, chosen) in enumerate(rows.items()):
            right, listed = (Rate.of(r[key] for r in chosen) for key in ("right", "listed"))
            colour = GREEN if name == "nulls, separately" else BLUE
            axes.barh(row, listed.share, height=0.6, color=LIGHT, zorder=2, label=labels[0])
            axes.barh(row, right.share, height=0.6, color=colour, zorder=3, label=labels[1])
            labels = (None, None)
            _whisker(axes, row, right, horizontal=True)
            axes.text(1.02, row, f"{right.successes}/{right.n}", va="center", fontsize=8)
        _name_rows(axes, list(rows))
        axes.set(xlim=(0, 1), xlabel="share")
        _legend_above(figure, axes)
    return figure


def reliability_figure(records: Records) -> Figure:
    """Draw how often the leading cause has the true kind against its stated probability."""
    with style():
        figure = new_figure(4.6, 4.4)
        axes = figure.subplots()
        axes.plot([0, 1], [0, 1], color=GREY, linewidth=1, linestyle=":", label="as stated")
        for stated in reliability(records):
            share = stated.right.share
            _whisker(axes, stated.mean, stated.right, horizontal=False)
            axes.plot(stated.mean, share, "o", color=BLUE, zorder=5)
            count = f"{stated.right.successes}/{stated.right.n}"
            # Vertical labels below the whiskers, because points near 1 are close together.
            foot = max(stated.right.low, LABEL_HEIGHT) - 0.01
            axes.text(stated.mean, foot, count, ha="center", va="top", fontsize=8, rotation=90)
        axes.set(xlim=(0, 1.02), ylim=(0, 1.03), aspect="equal")
        axes.set(xlabel="stated probability of the leading cause", ylabel="share of the true kind")
        _legend_above(figure, axes)
    return figure


def coverage_figure(records: Records) -> Figure:
    """Draw the actual against the nominal coverage of the intervals.

    At each level the band contains 95 % of the curves of correct intervals.
    """
    from scipy.stats import binom, halfnorm

    level = np.linspace(0.0, 1.0, 801)
    with style():
        figure = new_figure(4.6, 4.6)
        axes = figure.subplots()
        axes.plot([0, 1], [0, 1], color=GREY, linewidth=1, linestyle=":")
        for window, (name, colour) in WINDOWS.items():
            chosen = [found for found in coefficients(records) if found["window"] == window]
            z = np.sort([abs(value) for found in chosen if (value := deviation(found)) is not None])
            if not z.size:
                continue
            if window is None:
                low, high = (binom.ppf(tail, z.size, level) / z.size for tail in (0.025, 0.975))
                axes.fill_between(level, low, high, color=LIGHT, alpha=0.6, linewidth=0)
            x = np.concatenate([[0.0], halfnorm.cdf(z), [1.0]])
            y = np.concatenate([[0.0], np.arange(1, z.size + 1) / z.size, [1.0]])
            axes.step(x, y, where="post", color=colour, label=f"{name}: {z.size}")
        axes.plot([0.95, 0.95], COVERAGE_TARGET, color=BLACK, linewidth=3, solid_capstyle="butt")
        axes.set(xlim=(0, 1.01), ylim=(0, 1.02), aspect="equal")
        axes.set(xlabel="nominal coverage", ylabel="actual coverage")
        _legend_above(figure, axes)
    return figure


def gains_figure(records: Records) -> Figure:
    """Draw the error reduction of each case with a law; ticks are medians."""
    shown = [kind for kind in KINDS if any(r["gains"] for r in of_kind(records, kind))]
    with style():
        figure = new_figure(6.8, 1.6 + 0.45 * len(shown))
        axes = figure.subplots()
        axes.set_xscale("log")
        axes.axvline(1, color=GREY, linewidth=1)
        for shift, (at, (name, colour, target)) in zip((-0.17, 0.17), GAINS.items(), strict=True):
            axes.axvline(target, color=colour, linewidth=1, linestyle="--")
            gains = {row + shift: _gains(of_kind(records, k), at) for row, k in enumerate(shown)}
            dots = [(gain, row) for row, values in gains.items() for gain in values]
            middles = [(np.median(values), row) for row, values in gains.items() if values]
            _scatter(axes, dots, "o", color=colour, alpha=0.45, label=f"{name}: {len(dots)}")
            _scatter(axes, middles, "|", color=BLACK, markersize=11, markeredgewidth=1.8)
        _name_rows(axes, [KINDS[kind] for kind in shown])
        axes.xaxis.set_major_formatter("{x:g}")
        axes.set(
            xlabel="error of the simulation from its fitted start / error of the corrected one"
        )
        _legend_above(figure, axes)
    return figure


class FigureSpec(NamedTuple):
    """A figure of the document: its function and its caption."""

    draw: Callable[[Records], Figure]
    caption: str


FIGURES = {
    "proof_scores.png": FigureSpec(scores_figure, "Verdicts by kind of hidden effect."),
    "proof_reliability.png": FigureSpec(
        reliability_figure,
        "How often the leading cause has the true kind, against its stated probability.",
    ),
    "proof_coverage.png": FigureSpec(
        coverage_figure,
        "Actual against nominal coverage of the intervals; grey: 95 % band of correct intervals, "
        "for terms that act everywhere; black: the target.",
    ),
    "proof_gains.png": FigureSpec(
        gains_figure,
        "Reduction of the error against the noise-free truth, compared with the simulation from "
        "its fitted start; dots: cases, ticks: medians, dashed: targets.",
    ),
}


def save_figures(records: Sequence[CaseRecord], folder: Path) -> None:
    """Save all figures of the document in a folder."""
    folder.mkdir(parents=True, exist_ok=True)
    for name, drawing in FIGURES.items():
        save_figure(drawing.draw(records), folder / name)


def _gains(records: Records, at: Gain) -> list[float]:
    known = [record["gains"][at] for record in records if record["gains"]]
    return [gain for gain in known if gain is not None]


def _scatter(axes: Axes, points: Sequence[tuple[Any, float]], mark: str, **look: Any) -> None:
    axes.plot([x for x, _ in points], [y for _, y in points], mark, **look)


def _whisker(axes: Axes, at: float, rate: Rate, *, horizontal: bool) -> None:
    """Draw the Wilson interval of a share."""
    ends, place = [rate.low, rate.high], [at, at]
    across, up = (ends, place) if horizontal else (place, ends)
    axes.plot(across, up, color=BLACK if horizontal else SKY, linewidth=1.2, zorder=4)


def _name_rows(axes: Axes, names: Sequence[str]) -> None:
    axes.set_yticks(range(len(names)), names)
    axes.set_ylim(max(len(names), 1) - 0.5, -0.5)
    axes.tick_params(axis="y", length=0)
    axes.grid(visible=False, axis="y")
    axes.grid(visible=True, axis="x")


def _legend_above(figure: Figure, axes: Axes) -> None:
    handles, labels = axes.get_legend_handles_labels()
    if handles:
        figure.legend(handles, labels, loc="outside upper left", ncols=2)
