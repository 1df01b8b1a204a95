"""A pandas.DataFrame as a table: columns as a CSV has them, and cells with a place."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from dashred.core.errors import InputError
from dashred.core.units import split_unit
from dashred.data.io.tables.csv_table import SECONDS_AS_NUMBERS
from dashred.data.io.tables.table_header import read_header

if TYPE_CHECKING:
    import pandas as pd


@dataclass(frozen=True, eq=False)
class FrameTable:
    """A table that is a DataFrame.

    Attributes:
        path: what messages call it.
        columns: names, without their units.
        units: unit of every column that states one: ``theta [rad]``.
        frame: the values, its columns in the order of ``columns``.
    """

    path: str
    columns: tuple[str, ...]
    units: Mapping[str, str]
    frame: pd.DataFrame

    @classmethod
    def of(cls, frame: pd.DataFrame, path: str, index: str) -> FrameTable:
        """Take a DataFrame for a table.

        Args:
            frame: the values.
            path: what messages call it.
            index: the column that its index may be, by the index' name.

        Raises:
            InputError: it is empty, has several levels of columns, a column has no name, or one
                that is used twice.
        """
        if frame.index.name is not None and split_unit(str(frame.index.name))[0] == index:
            frame = frame.reset_index()
        if not len(frame.columns) or not len(frame):
            raise InputError("the DataFrame is empty", where=path)
        if frame.columns.nlevels > 1:
            hint = "give each column one name: df.columns = [...]"
            raise InputError("the columns have several levels of names", where=path, hint=hint)
        names, units = read_header([str(name) for name in frame.columns], path)
        return cls(path, names, units, frame)

    def __len__(self) -> int:
        """Count of rows."""
        return len(self.frame)

    def location(self, row: int, column: str | None = None) -> str:
        """Where a row or a cell stands: ``recording.iloc[16], column 'theta'``."""
        line = f"{self.path}.iloc[{row}]"
        return line if column is None else f"{line}, column {column!r}"

    def header_location(self, column: str) -> str:
        """Where a column is: ``recording, column 'theta'``."""
        return f"{self.path}, column {column!r}"

    def texts(self, column: str) -> list[str]:
        """The column's cells as texts."""
        series = self._series(column)
        missing = series.isna().to_list()
        return ["" if gap else str(cell).strip() for cell, gap in zip(series, missing, strict=True)]

    def numbers(self, column: str) -> NDArray[np.float64]:
        """The column as float64, shape (row,).

        Raises:
            InputError: its dtype is not one of real numbers.
        """
        series = self._series(column)
        if getattr(series.dtype, "kind", "O") not in "fiu":
            hint = "convert it first, for example by pandas.to_numeric"
            if series.dtype.kind in "Mm":
                hint = SECONDS_AS_NUMBERS
            problem = f"the column does not hold numbers: its dtype is {series.dtype}"
            raise InputError(problem, where=self.header_location(column), hint=hint)
        return np.array(series.to_numpy(dtype=np.float64, na_value=np.nan))

    def _series(self, column: str) -> pd.Series:
        return self.frame.iloc[:, self.columns.index(column)]
