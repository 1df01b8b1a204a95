"""A table of named columns, whatever holds it: what the readers of recordings and sensors need."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Protocol

import numpy as np
from numpy.typing import NDArray


class Columns(Protocol):
    """A rectangular table that can say where each of its cells stands."""

    @property
    def path(self) -> str:
        """What messages call the table."""

    @property
    def columns(self) -> tuple[str, ...]:
        """Names of the columns, unique and not empty, without their units."""

    @property
    def units(self) -> Mapping[str, str]:
        """Unit of every column that states one."""

    def __len__(self) -> int:
        """Count of rows."""

    def location(self, row: int, column: str | None = None) -> str:
        """Where a row or a cell stands."""

    def header_location(self, column: str) -> str:
        """Where the name of a column stands."""

    def texts(self, column: str) -> list[str]:
        """The column's cells as texts; an empty text is a missing value."""

    def numbers(self, column: str) -> NDArray[np.float64]:
        """The column as float64, shape (row,); NaN is a missing value.

        Raises:
            InputError: there is a cell that is not a number.
        """
