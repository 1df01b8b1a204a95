"""One way in for recordings: the file's ending decides who reads it."""

from __future__ import annotations

from pathlib import Path

from dashred.core.errors import InputError
from dashred.data.episodes import Episodes
from dashred.data.io.read_csv import read_csv
from dashred.data.io.read_netcdf import read_netcdf
from dashred.data.recording import Recording
from dashred.data.sensors import Described


def read_recording(path: str, sensors_table: str | None, system: Described) -> Recording:
    """Read a recording of one episode.

    Raises:
        InputError: for several episodes, or whatever :func:`read_episodes` refuses.
    """
    return read_episodes(path, sensors_table, system).alone(path)


def read_episodes(path: str, sensors_table: str | None, system: Described) -> Episodes:
    """Read a recording of this system from ``.csv`` (with its table of sensors) or ``.nc``.

    Raises:
        InputError: for another ending, or whatever fault the reader of the format finds.
    """
    ending = Path(path).suffix.lower()
    if ending == ".csv":
        return read_csv(path, sensors_table, system)
    if ending != ".nc":
        problem = f"recordings are .csv or .nc files, not {ending or 'files without an ending'}"
        raise InputError(problem, where=path)
    if sensors_table is not None:
        problem = f"a NetCDF recording describes its sensors itself, but {sensors_table} is given"
        raise InputError(problem, where=path, hint="leave recording.sensors out")
    return read_netcdf(path, system)
