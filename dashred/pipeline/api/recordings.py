"""Read the recording of a problem: a Dataset, a DataFrame or a file."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

from dashred.config import Config
from dashred.core.errors import InputError
from dashred.data.episodes import Episodes
from dashred.data.io.in_memory import RECORDING, SENSORS, read_in_memory, table_of_sensors
from dashred.data.io.read_csv import episodes_of_file
from dashred.data.io.tables.table_dialect import NETCDF
from dashred.physics.system import System
from dashred.pipeline.input.read_recorded import layout_of_table, read_recorded


def recording_overrides(recording: Any, sensors: Any) -> dict[str, Any]:
    """Return the configuration values for the paths of the recording and of its sensor table.

    A recording in memory gets a name in place of a path.
    """
    overrides: dict[str, Any] = {}
    if recording is not None:
        overrides["recording.path"] = os.fspath(recording) if is_path(recording) else RECORDING
    if is_path(sensors):
        overrides["recording.sensors"] = os.fspath(sensors)
    return overrides


def read_recording(recording: Any, sensors: Any, config: Config, system: System) -> Episodes | None:
    """Read the recording; return None if there is none.

    Args:
        recording: Dataset, DataFrame or path; None uses the recording of the configuration.
        sensors: sensor table, a DataFrame or a path; None uses the table of the configuration.
        config: configuration of the system, with resolved paths.
        system: recorded system.

    Raises:
        InputError: the recording or the sensor table is invalid.
    """
    configured = config.recording.sensors
    table = configured if is_path(sensors) or sensors is None else sensors
    if recording is not None and not is_path(recording):
        table = None if isinstance(table, int) else table
        return read_in_memory(recording, table, system, layout_of_table(config))
    path = config.recording.path
    if path is None:
        if sensors is not None:
            hint = "give recording= too"
            raise InputError("sensors are given without a recording", where=SENSORS, hint=hint)
        return None
    if table is configured:
        return read_recorded(config, system)
    if Path(path).suffix.lower() == NETCDF:
        what = "a NetCDF recording describes its sensors itself, but sensors= is given"
        raise InputError(what, where=path, hint="omit sensors=")
    return episodes_of_file(path, table_of_sensors(table), system, layout_of_table(config))


def is_path(given: object) -> bool:
    """Return whether an argument is a path."""
    return isinstance(given, str | os.PathLike)
