"""What was found out, and the objects that it can be looked at with."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

from dashred.core.files.user_path import user_path
from dashred.pipeline.api.plots import Plots
from dashred.pipeline.api.simulator import Simulator
from dashred.pipeline.outputs.figures import Figures
from dashred.reporting.page.html import notebook_html
from dashred.reporting.text.summary import summary
from dashred.reporting.text.verdict import law

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr


class Result:
    """What a simulation leaves out, as far as the recording shows it.

    Attributes:
        findings: everything that was found, as ``findings.json`` holds it: plain dicts and lists.
        estimates: every field by method over ``(method, time, *axes)`` in the fit window; None
            where the simulator was not resolved.
        forecast: the same beyond the recording's end, from free runs; None where there are none.
    """

    def __init__(
        self,
        findings: Mapping[str, Any],
        estimates: xr.Dataset | None,
        forecast: xr.Dataset | None,
        find_corrected: Callable[[], Simulator | None],
        figures: Figures,
        mostly: list[str],
        write: Callable[[Path], None],
    ) -> None:
        """Hold what was found.

        Args:
            findings: of ``findings.json``.
            estimates: by method.
            forecast: by method.
            find_corrected: returns the corrected simulator.
            figures: what draws each figure, by file.
            mostly: of more terms than a few, the words of the few that explain nearly all.
            write: writes the files to a folder.
        """
        self.findings, self.estimates, self.forecast = findings, estimates, forecast
        self._find_corrected, self._figures = find_corrected, figures
        self._mostly, self._write = mostly, write

    @property
    def verdict(self) -> str:
        """The verdict in a word, such as ``missing-term`` or ``nothing-missing``."""
        return str(self.findings["verdict"])

    @property
    def law(self) -> str:
        """What the simulation leaves out, in words; empty if nothing was found."""
        return " ".join(law(self.findings))

    @cached_property
    def terms(self) -> pd.DataFrame:
        """The terms of the law, a row each, with standard deviations and 95 % intervals."""
        from dashred.pipeline.api.tables import terms_table

        return terms_table(self.findings)

    @cached_property
    def alternatives(self) -> pd.DataFrame:
        """The other laws that were weighed, a row each, with the evidence against them."""
        from dashred.pipeline.api.tables import alternatives_table

        return alternatives_table(self.findings)

    @cached_property
    def corrected(self) -> Simulator | None:
        """The simulator with the law put in, from the fitted start; None without a law.

        Raises:
            InputError: the result was loaded, and the system has inputs, which its files lack.
        """
        return self._find_corrected()

    @cached_property
    def plot(self) -> Plots:
        """The figures."""
        return Plots(self._figures)

    def save(self, folder: str | os.PathLike[str]) -> Path:
        """Write the files that a run leaves in ``output=``: findings, fields, figures, report.

        Args:
            folder: is made if there is none; a result in it is replaced.

        Returns:
            The folder.

        Raises:
            InputError: it cannot be made or written to, or holds such files of another origin.
        """
        place = user_path(os.fspath(folder), "save").absolute()
        self._write(place)
        return place

    def __str__(self) -> str:
        """The printed summary of a run."""
        return summary(self.findings, None, {})

    def __repr__(self) -> str:
        """The verdict and the law."""
        return f"<dashred.Result {self.verdict}{f': {self.law}' if self.law else ''}>"

    def _repr_html_(self) -> str:
        return notebook_html(self.findings, self._mostly)
