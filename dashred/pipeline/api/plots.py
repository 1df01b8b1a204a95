"""Figures of a result, drawn on demand."""

from __future__ import annotations

import sys
from collections.abc import Sequence

from matplotlib.figure import Figure

from dashred.core.errors import InputError
from dashred.pipeline.outputs.figures import Figures
from dashred.reporting.figures.figure_names import HELD_OUT_EPISODE, sensor_figure_of_episode


class Plots:
    """The figures of the report, as ``matplotlib.figure.Figure``.

    Each method raises `InputError` if the result does not have the figure.

    Attributes:
        names: names of the figures of this result.
    """

    def __init__(self, figures: Figures) -> None:
        """Store the functions that draw the figures, by file name."""
        self._figures = figures
        self.names = [name.removesuffix(".png") for name in figures]

    def where(self) -> Figure:
        """Draw where and when the law acts, and which sensors it affects."""
        return self._draw("where.png")

    def verification(self) -> Figure:
        """Draw the test sensors with and without the law, and the errors of all methods."""
        return self._draw("verification.png")

    def forecast(self) -> Figure:
        """Draw the forecasts with and without the law, from the held-out time on."""
        return self._draw("forecast.png")

    def evidence(self) -> Figure:
        """Draw the coefficients with their intervals, and the evidence by number of terms."""
        return self._draw("evidence.png")

    def forcing(self) -> Figure:
        """Draw the free forcing over space and time, if one was fitted."""
        return self._draw("forcing.png")

    def fields(self) -> Figure:
        """Draw the fields by method over space and time; only for systems with axes."""
        return self._draw("space_time.png", "snapshots.png")

    def sensors(self, episode: int = 1) -> Figure:
        """Draw the recording of every sensor with the estimates of the methods.

        Args:
            episode: number of the episode, from 1 on; the longest episode is the first.
        """
        return self._draw(sensor_figure_of_episode(episode))

    def held_out_episode(self) -> Figure:
        """Draw the episode that was held out as a whole."""
        return self._draw(HELD_OUT_EPISODE)

    def coefficients(self) -> Figure:
        """Draw the coefficients that latent SINDy proposes, by epoch of assimilation."""
        return self._draw("coefficients.png")

    def sparsity(self) -> Figure:
        """Draw the accuracy of latent SINDy and of the law against the number of terms."""
        return self._draw("sparsity.png")

    def learning(self) -> Figure:
        """Draw the learning curves of the networks."""
        return self._draw("learning.png")

    def __repr__(self) -> str:
        """The names of the figures."""
        return f"<dashred figures: {', '.join(self.names) or 'none'}>"

    def _draw(self, *names: str) -> Figure:
        name = next((name for name in names if name in self._figures), None)
        if name is None:
            hint = f"it has {', '.join(self.names)}" if self.names else "it has no figures"
            what = f"this result has no figure {names[0].removesuffix('.png')}"
            raise InputError(what, where="plot", hint=hint)
        _show_in_notebook()
        return self._figures[name]()


def _show_in_notebook() -> None:
    """Register a formatter for figures in IPython, if there is none."""
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
