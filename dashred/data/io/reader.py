"""Reading of a recording: NetCDF, or a table of text."""

from __future__ import annotations

from pathlib import Path

from dashred.core.errors import InputError
from dashred.data.episodes import Episodes
from dashred.data.io.read_csv import read_csv
from dashred.data.io.read_netcdf import read_netcdf
from dashred.data.io.tables.table_dialect import NETCDF
from dashred.data.io.tables.table_layout import TableLayout
from dashred.data.recording import Recording
from dashred.data.sensors import SystemDescription

NO_LAYOUT = TableLayout()


def read_recording(path: str, sensors_table: str | None, system: SystemDescription) -> Recording:
    """Read a recording with one episode.

    Raises:
        InputError: for several episodes, or as in :func:`read_episodes`.
    """
    return read_episodes(path, sensors_table, system).single(path)


def read_episodes(
    path: str,
    sensors_table: str | None,
    system: SystemDescription,
    layout: TableLayout = NO_LAYOUT,
) -> Episodes:
    """Read a recording of a system from ``.nc``, or from a table of text with any other ending.

    Args:
        path: of the recording.
        sensors_table: path of the table of sensors; None for NetCDF and for ODE systems.
        system: that the sensors observe.
        layout: what is known of a table before it is read; of a NetCDF, the part that is used.

    Raises:
        InputError: the file is invalid.
    """
    if Path(path).suffix.lower() != NETCDF:
        return read_csv(path, sensors_table, system, layout)
    if sensors_table is not None:
        problem = f"a NetCDF recording describes its sensors itself, but {sensors_table} is given"
        raise InputError(problem, where=path, hint="remove recording.sensors")
    return read_netcdf(path, system, layout.part)
