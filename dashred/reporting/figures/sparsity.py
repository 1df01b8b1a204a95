"""Accuracy against sparsity, as in the paper's Fig. 7: of latent SINDy, and of the law."""

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
CHOSEN, REPORTED, ELSEWHERE = "ring: chosen", "ring: reported", "the law reported is none of these"
HOLLOW = (
    "hollow: errs more than a smaller set, so it is not the best of its size: the refit of a law "
    "did not converge, or of latent SINDy no better set was tried"
)
# The score is drawn linearly below this, where laws compete.
LINEAR = 10.0
# A best of its size errs no more than one of fewer terms, but for what ends a refit.
SLACK = 1.01
# Smaller errors, as a share of the target, are rounding.
ROUNDING = 1e-10

Values = Float[np.ndarray, " size"]


@dataclass(frozen=True)
class LatentPath:
    """Latent SINDy's regressions by their number of terms.

    Attributes:
        sizes: numbers of terms, ``(size,)``.
        rmse: the error of each, as a share of the target's rms, ``(size,)``.
        blocks: how many parts of the record were redrawn as a whole: they count as one reading
            each, as those within are not independent.
        kept: the number of terms that is proposed.
    """

    sizes: Int[np.ndarray, " size"]
    rmse: Values
    blocks: int
    kept: int

    @property
    def evidence(self) -> Values:
        """Return ``BIC = n ln rmse² + k ln n`` of each size, beyond the lowest; ``(size,)``."""
        n = self.blocks
        score = 2 * n * np.log(np.maximum(self.rmse, ROUNDING)) + self.sizes * np.log(n)
        return np.asarray(score - score.min())


def accuracy_against_sparsity(
    latent: Mapping[str, LatentPath],
    law: Sequence[tuple[int, float, float]],
    reported: int | None,
) -> Figure:
    """Draw error and evidence against the number of terms; rings are the choice.

    Args:
        latent: by algorithm.
        law: of the best law of each size, the number of terms, its misfit in σ, its score.
        reported: which of them the findings report; None where they report another.
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
        for row, choice in ((above, CHOSEN), (below, REPORTED if len(at) else ELSEWHERE)):
            row[1].set(ylabel="ΔBIC to the best", title="its evidence")
            row[1].set_yscale("symlog", linthresh=LINEAR)
            row[1].set_ylim(bottom=-LINEAR / 4)
            for axes in row:
                axes.set_xlabel(f"number of terms ({choice})")
                axes.xaxis.set_major_locator(MaxNLocator(integer=True))
        if hollow:
            figure.supxlabel(HOLLOW, fontsize=8, color="#5a5a5a", x=0.01, ha="left")
    return figure


def best_of_size(errors: Values) -> Bool[np.ndarray, " size"]:
    """Return which sets can be the best of their size: a term more never errs more.

    Args:
        errors: of the sets, the smallest set first.
    """
    return np.asarray(errors <= SLACK * np.minimum.accumulate(errors))


def _draw(
    axes: Axes,
    sizes: Values | Int[np.ndarray, " size"],
    values: Values,
    best: Bool[np.ndarray, " size"],
    chosen: Int[np.ndarray, " choice"],
    colour: str,
    label: str,
) -> None:
    """Join the best of their sizes, leave the others hollow, and ring what was chosen."""
    axes.plot(sizes[best], values[best], "o-", color=colour, markersize=4, label=label)
    for others, marks in (
        (~best, {"markersize": 4, "markerfacecolor": "none"}),
        (chosen, RING),
    ):
        if len(sizes[others]):
            axes.plot(sizes[others], values[others], "o", markeredgecolor=colour, **marks)
