"""Result of an analysis."""

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
from dashred.reporting.text.laws import law
from dashred.reporting.text.summary import summary

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr


class Result:
    """Result of an analysis: what the simulation leaves out.

    Attributes:
        findings: content of ``findings.json`` as plain dicts and lists.
        estimates: fields by method over ``(method, time, *axes)`` in the fit window; None if the
            simulator is not resolved.
        forecast: fields of the free runs after the end of the recording, with the same dimensions;
            None if there are no free runs.
    """

    def __init__(
        self,
        findings: Mapping[str, Any],
        estimates: xr.Dataset | None,
        forecast: xr.Dataset | None,
        build_corrected: Callable[[], Simulator | None],
        figures: Figures,
        main_effects: list[str],
        write: Callable[[Path], None],
    ) -> None:
        """Store the parts of a result.

        Args:
            findings: content of ``findings.json``.
            estimates: fields by method in the fit window.
            forecast: fields by method after the end of the recording.
            build_corrected: returns the corrected simulator.
            figures: functions that draw the figures, by file name.
            main_effects: if the law has many terms, the effects of the few most important ones.
            write: writes the files to a folder.
        """
        self.findings, self.estimates, self.forecast = findings, estimates, forecast
        self._build_corrected, self._figures = build_corrected, figures
        self._main_effects, self._write = main_effects, write

    @property
    def verdict(self) -> str:
        """The verdict, such as ``missing-term``, ``nothing-missing`` or ``unconfirmed``."""
        return str(self.findings["verdict"])

    @property
    def law(self) -> str:
        """The law in words; empty if nothing was found."""
        return " ".join(law(self.findings))

    @cached_property
    def terms(self) -> pd.DataFrame:
        """The terms of the law, one per row, with standard deviations and 95 % intervals."""
        from dashred.pipeline.api.tables import terms_table

        return terms_table(self.findings)

    @cached_property
    def fitted_parameters(self) -> pd.DataFrame:
        """The parameters that are stated with a spread, one per row, with 95 % intervals."""
        from dashred.pipeline.api.tables import fitted_parameters_table

        return fitted_parameters_table(self.findings)

    @property
    def hidden_state(self) -> Mapping[str, Any] | None:
        """The hidden state of the law, with time constant and gain; None without one."""
        found: Mapping[str, Any] | None = self.findings.get("hidden_state")
        return found

    @cached_property
    def alternatives(self) -> pd.DataFrame:
        """The other laws that were compared, one per row, with the evidence against them."""
        from dashred.pipeline.api.tables import alternatives_table

        return alternatives_table(self.findings)

    @cached_property
    def corrected(self) -> Simulator | None:
        """The simulator with the law, at its fitted start; None if no law was found.

        Raises:
            InputError: the result was loaded from files and the system has inputs, which the files
                do not contain.
        """
        return self._build_corrected()

    @cached_property
    def plot(self) -> Plots:
        """The figures of the report."""
        return Plots(self._figures)

    def save(self, folder: str | os.PathLike[str]) -> Path:
        """Write the files of a run: findings, fields, figures and report.

        Args:
            folder: output folder. It is created if necessary, and a result in it is replaced.

        Returns:
            The folder.

        Raises:
            InputError: the folder cannot be created or written to, or it contains such files that
                dashred has not written.
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
        return notebook_html(self.findings, self._main_effects)
