"""The figures of a result, each drawn when it is asked for."""

from __future__ import annotations

import sys
from collections.abc import Sequence

from matplotlib.figure import Figure

from dashred.core.errors import InputError
from dashred.pipeline.outputs.figures import Figures
from dashred.reporting.figures.figure_names import HELD_OUT_EPISODE, sensor_figure_of_episode


class Plots:
    """The report's figures, as ``matplotlib.figure.Figure``.

    Attributes:
        names: of the figures that this result has.
    """

    def __init__(self, figures: Figures) -> None:
        """Hold what draws them, by file."""
        self._figures = figures
        self.names = [name.removesuffix(".png") for name in figures]

    def where(self) -> Figure:
        """Draw where and when the law acts, and at which sensors it shows."""
        return self._draw("where.png")

    def verification(self) -> Figure:
        """Draw the test sensors with and without the law, and every method's errors."""
        return self._draw("verification.png")

    def forecast(self) -> Figure:
        """Draw sensors of the held-out time and beyond, foretold with and without the law."""
        return self._draw("forecast.png")

    def evidence(self) -> Figure:
        """Draw the coefficients with their intervals, and the evidence by number of terms."""
        return self._draw("evidence.png")

    def forcing(self) -> Figure:
        """Draw what a free forcing would add, where and when; only where a law left a question."""
        return self._draw("forcing.png")

    def fields(self) -> Figure:
        """Draw the fields by method, over space and time; systems with axes alone have them."""
        return self._draw("space_time.png", "snapshots.png")

    def sensors(self, episode: int = 1) -> Figure:
        """Draw what every sensor recorded, and what the methods make of it.

        Args:
            episode: counted from 1, the longest first.
        """
        return self._draw(sensor_figure_of_episode(episode))

    def held_out_episode(self) -> Figure:
        """Draw the episode that was held out whole, if one was."""
        return self._draw(HELD_OUT_EPISODE)

    def coefficients(self) -> Figure:
        """Draw what latent SINDy proposes, by epoch of assimilation."""
        return self._draw("coefficients.png")

    def sparsity(self) -> Figure:
        """Draw accuracy against the number of terms: latent SINDy, and the law."""
        return self._draw("sparsity.png")

    def learning(self) -> Figure:
        """Draw the learning curves of the networks."""
        return self._draw("learning.png")

    def __repr__(self) -> str:
        """The figures that there are."""
        return f"<dashred figures: {', '.join(self.names) or 'none'}>"

    def _draw(self, *names: str) -> Figure:
        name = next((name for name in names if name in self._figures), None)
        if name is None:
            has = f"it has {', '.join(self.names)}" if self.names else "it has none"
            what = f"this result has no figure {names[0].removesuffix('.png')}"
            raise InputError(what, where="plot", hint=has)
        _show_in_notebook()
        return self._figures[name]()


def _show_in_notebook() -> None:
    """Let a notebook show a figure that is the value of a cell, unless it does so already."""
    if "IPython" not in sys.modules:
        return
    from IPython import get_ipython
    from IPython.core.pylabtools import select_figure_formats

    shell = get_ipython()
    if shell is None:
        return
    formats: Sequence[str] = ("image/png", "image/svg+xml", "image/jpeg", "application/pdf")
    formatters = shell.display_formatter.formatters
    if not any(Figure in formatters[kind].type_printers for kind in formats):
        select_figure_formats(shell, {"png"})
