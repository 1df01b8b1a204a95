"""Accuracy against sparsity, as in the paper's Fig. 7: of latent SINDy, and of the law."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from jaxtyping import Float, Int
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from dashred.reporting.style import CYCLE, GREEN, new_figure, style

RING: dict[str, Any] = {"markersize": 12, "markerfacecolor": "none", "markeredgewidth": 1.6}
REPORTED, ELSEWHERE = "ring: reported", "the law reported is none of these"
# The score is drawn linearly below this, where laws compete.
LINEAR = 10.0


def accuracy_against_sparsity(
    latent: Mapping[str, tuple[Int[np.ndarray, " step"], Float[np.ndarray, " step"], int]],
    law: Sequence[tuple[int, float, float]],
    reported: int | None,
) -> Figure:
    """Draw error, and for the law evidence too, against the number of terms; rings are the choice.

    Args:
        latent: by algorithm, numbers of terms, RMSE of the regression for each, the number chosen.
        law: of the best law of each size, the number of terms, its misfit in σ, its score.
        reported: which of them the findings report; None where they report another.
    """
    sizes, misfits, scores = (np.array(part, float) for part in zip(*law, strict=True))
    with style():
        figure = new_figure(9.6, 3.3)
        left, middle, right = figure.subplots(1, 3)
        for colour, (name, (terms, rmse, kept)) in zip(CYCLE, latent.items(), strict=False):
            left.plot(terms, rmse, "o-", color=colour, markersize=4, label=f"{name}: {kept} kept")
            at = np.flatnonzero(np.asarray(terms) == kept)
            _ring(left, np.asarray(terms)[at], np.asarray(rmse)[at], colour)
        left.legend(loc="upper right")
        left.set(ylabel="RMSE of the regression", title="latent SINDy")
        middle.semilogy(sizes, misfits, "o-", color=GREEN, markersize=4)
        middle.set(ylabel="RMSE at the sensors / noise", title="law, through the simulator")
        right.plot(sizes, scores - scores.min(), "o-", color=GREEN, markersize=4)
        right.set_yscale("symlog", linthresh=LINEAR)
        right.set(ylabel="ΔBIC to the best", title="its evidence")
        right.set_ylim(bottom=-LINEAR / 4)
        left.set_xlabel("number of terms (ring: chosen)")
        for axes, values in ((middle, misfits), (right, scores - scores.min())):
            axes.set_xlabel(f"number of terms ({ELSEWHERE if reported is None else REPORTED})")
            if reported is not None:
                _ring(axes, sizes[reported], values[reported], GREEN)
        for axes in (left, middle, right):
            axes.xaxis.set_major_locator(MaxNLocator(integer=True))
    return figure


def _ring(axes: Axes, size: Any, value: Any, colour: str) -> None:
    axes.plot(size, value, "o", markeredgecolor=colour, **RING)
