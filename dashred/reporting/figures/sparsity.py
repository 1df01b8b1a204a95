"""Accuracy against sparsity of latent SINDy and of the law, as in Fig. 7 of the paper."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Bool, Float, Int
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from dashred.reporting.figures.style import CYCLE, GREEN, new_figure, style

RING: dict[str, Any] = {"markersize": 12, "markerfacecolor": "none", "markeredgewidth": 1.6}
CHOSEN, REPORTED, NOT_SHOWN = "ring: chosen", "ring: reported", "the reported law is not shown"
HOLLOW = (
    "hollow: larger error than a smaller set, so not the best set of its size: the refit of a law "
    "did not converge, or latent SINDy tried no better set"
)
# The scale of the score is linear below this value.
LINEAR = 10.0
# Tolerance of a refit: a larger set may have a larger error by this factor.
TOLERANCE = 1.01
# Smaller errors relative to the target are rounding errors.
ROUNDING = 1e-10

Values = Float[np.ndarray, " size"]


@dataclass(frozen=True)
class LatentPath:
    """Regressions of latent SINDy by number of terms.

    Attributes:
        sizes: numbers of terms, ``(size,)``.
        rmse: error relative to the RMS of the target, ``(size,)``.
        blocks: number of blocks of the bootstrap. Samples within a block are not independent, so
            each block counts as one sample.
        kept: number of terms of the proposal.
    """

    sizes: Int[np.ndarray, " size"]
    rmse: Values
    blocks: int
    kept: int

    @property
    def evidence(self) -> Values:
        """``BIC = n ln rmse² + k ln n`` of each size, minus the lowest, ``(size,)``."""
        # A few samples make no block.
        n = max(1, self.blocks)
        score = 2 * n * np.log(np.maximum(self.rmse, ROUNDING)) + self.sizes * np.log(n)
        return np.asarray(score - score.min())


def accuracy_against_sparsity(
    latent: Mapping[str, LatentPath],
    law: Sequence[tuple[int, float, float]],
    reported: int | None,
) -> Figure:
    """Plot error and evidence against the number of terms; rings mark the selected sets.

    Args:
        latent: regressions by algorithm.
        law: number of terms, misfit in σ and score of the best law of each size.
        reported: index of the reported law; None if it is not among these.
    """
    sizes, misfits, scores = (np.array(part, float) for part in zip(*law, strict=True))
    with style():
        figure = new_figure(9.0, 5.8)
        above, below = figure.subplots(2, 2)
        hollow = False
        for colour, (name, path) in zip(CYCLE, latent.items(), strict=False):
            best, at = best_of_size(path.rmse), np.flatnonzero(path.sizes == path.kept)
            hollow |= not best.all()
            label = f"{name}: {path.kept} kept"
            for axes, values in zip(above, (path.rmse, path.evidence), strict=True):
                _draw(axes, path.sizes, values, best, at, colour, label)
        best = best_of_size(misfits)
        hollow |= not best.all()
        at = np.array([] if reported is None else [reported], dtype=int)
        for axes, values in zip(below, (misfits, scores - scores.min()), strict=True):
            _draw(axes, sizes, values, best, at, GREEN, "")
        above[0].legend(loc="upper right")
        above[0].set(ylabel="RMSE of the regression", title="latent SINDy")
        below[0].set(ylabel="RMSE at the sensors / noise", title="law, through the simulator")
        below[0].set_yscale("log")
        for row, choice in ((above, CHOSEN), (below, REPORTED if len(at) else NOT_SHOWN)):
            row[1].set(ylabel="ΔBIC relative to the best", title="evidence")
            row[1].set_yscale("symlog", linthresh=LINEAR)
            row[1].set_ylim(bottom=-LINEAR / 4)
            for axes in row:
                axes.set_xlabel(f"number of terms ({choice})")
                axes.xaxis.set_major_locator(MaxNLocator(integer=True))
        if hollow:
            figure.supxlabel(HOLLOW, fontsize=8, color="#5a5a5a", x=0.01, ha="left")
    return figure


def best_of_size(errors: Values) -> Bool[np.ndarray, " size"]:
    """Return which sets can be the best of their size: a further term cannot increase the error.

    Args:
        errors: errors of the sets, in order of size.
    """
    return np.asarray(errors <= TOLERANCE * np.minimum.accumulate(errors))


def _draw(
    axes: Axes,
    sizes: Values | Int[np.ndarray, " size"],
    values: Values,
    best: Bool[np.ndarray, " size"],
    chosen: Int[np.ndarray, " choice"],
    colour: str,
    label: str,
) -> None:
    """Draw a line through the best sets, hollow dots for the others, and rings for the selected."""
    axes.plot(sizes[best], values[best], "o-", color=colour, markersize=4, label=label)
    for subset, marks in (
        (~best, {"markersize": 4, "markerfacecolor": "none"}),
        (chosen, RING),
    ):
        if len(sizes[subset]):
            axes.plot(sizes[subset], values[subset], "o", markeredgecolor=colour, **marks)
