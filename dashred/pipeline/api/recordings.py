"""The recording of a problem, from whatever it was given as."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

from dashred.config import Config
from dashred.core.errors import InputError
from dashred.data.episodes import Episodes
from dashred.data.io.csv_table import read_table
from dashred.data.io.in_memory import RECORDING, SENSORS, read_in_memory, table_of_sensors
from dashred.data.io.read_csv import episodes_of_table
from dashred.physics.system import System
from dashred.pipeline.problem import read_recorded


def overrides_for(recording: Any, sensors: Any) -> dict[str, Any]:
    """Return the values that say where the recording lies.

    A recording in memory has a name in place of a path: it lies nowhere.
    """
    found: dict[str, Any] = {}
    if recording is not None:
        found["recording.path"] = os.fspath(recording) if is_path(recording) else RECORDING
    if is_path(sensors):
        found["recording.sensors"] = os.fspath(sensors)
    return found


def read_given(recording: Any, sensors: Any, config: Config, system: System) -> Episodes | None:
    """Read the recording; None where there is none.

    Args:
        recording: a Dataset, a DataFrame or a path; None takes the configuration's own.
        sensors: the table of sensors, a DataFrame or a path; None takes the configuration's own.
        config: of the system, with paths settled.
        system: that was recorded.

    Raises:
        InputError: whatever is wrong with it.
    """
    stated = config.recording.sensors
    places = stated if is_path(sensors) or sensors is None else sensors
    if recording is not None and not is_path(recording):
        return read_in_memory(recording, None if isinstance(places, int) else places, system)
    path = config.recording.path
    if path is None:
        if sensors is not None:
            hint = "give recording= with it"
            raise InputError("sensors are given without a recording", where=SENSORS, hint=hint)
        return None
    if places is stated:
        return read_recorded(config, system)
    if Path(path).suffix.lower() != ".csv":
        problem = "a NetCDF recording describes its sensors itself, but sensors= is given"
        raise InputError(problem, where=path, hint="leave sensors= out")
    return episodes_of_table(read_table(path), table_of_sensors(places), system)


def is_path(given: object) -> bool:
    """Whether it names a file."""
    return isinstance(given, str | os.PathLike)
