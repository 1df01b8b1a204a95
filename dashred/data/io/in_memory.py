"""Recordings that are in memory already: a pandas.DataFrame, or an xarray.Dataset."""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING, Any

from dashred.core.errors import InputError
from dashred.data.episodes import Episodes
from dashred.data.io.read_csv import episodes_of_table
from dashred.data.io.read_netcdf import episodes_of_dataset
from dashred.data.io.tables.columns import Columns
from dashred.data.io.tables.csv_table import read_table
from dashred.data.io.tables.frame_table import FrameTable
from dashred.data.io.tables.table_layout import TableLayout
from dashred.data.sensors import SystemDescription

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr

RECORDING, SENSORS = "recording", "sensors"
HINT = "give an xarray.Dataset, a pandas.DataFrame, or the path of a .csv or .nc file"


def read_in_memory(
    recording: xr.Dataset | pd.DataFrame,
    sensors: pd.DataFrame | str | None,
    system: SystemDescription,
    layout: TableLayout,
) -> Episodes:
    """Read a recording as :func:`dashred.data.io.reader.read_episodes` reads a file.

    Args:
        recording: a Dataset in the layout of :mod:`dashred.data.io.write_netcdf`, or a DataFrame
            with the columns of a CSV; ``time`` may be its index.
        sensors: the table of sensors of a DataFrame, or the path of one.
        system: that was recorded.
        layout: the part that is used, and what is known of a DataFrame; the names of its columns
            are its own.

    Raises:
        InputError: it is of another type, or whatever fault the reader of a file would find.
    """
    if is_dataset(recording):
        if sensors is not None:
            problem = "a Dataset describes its sensors itself, but sensors= is given"
            raise InputError(problem, where=RECORDING, hint="leave sensors= out")
        return episodes_of_dataset(recording, RECORDING, system, layout.part)
    if is_frame(recording):
        table = FrameTable.of(recording, RECORDING, "time")
        return episodes_of_table(table, table_of_sensors(sensors), system, layout)
    problem = f"a recording cannot be of the type {type(recording).__name__}"
    hint = "name it: array.to_dataset(name='value')" if _is(recording, "xarray.DataArray") else HINT
    raise InputError(problem, where=RECORDING, hint=hint)


def table_of_sensors(sensors: Any) -> Columns | None:
    """Return the table of sensors, from a DataFrame or a file; None for none.

    Raises:
        InputError: it is of another type, or cannot be read.
    """
    if sensors is None:
        return None
    if isinstance(sensors, str):
        return read_table(sensors)
    if is_frame(sensors):
        return FrameTable.of(sensors, SENSORS, "name")
    problem = f"a table of sensors cannot be of the type {type(sensors).__name__}"
    raise InputError(problem, where=SENSORS, hint="give a pandas.DataFrame, or a path")


def is_dataset(given: object) -> bool:
    """Whether it is an xarray.Dataset."""
    return _is(given, "xarray.Dataset")


def is_frame(given: object) -> bool:
    """Whether it is a pandas.DataFrame."""
    return _is(given, "pandas.DataFrame")


def _is(given: object, name: str) -> bool:
    # Nobody has an object of a library that is not imported: we need not wait for it either.
    library, _, kind = name.partition(".")
    return library in sys.modules and isinstance(given, getattr(sys.modules[library], kind))
