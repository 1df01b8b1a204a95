"""Reader of NetCDF recordings, in the layout of :mod:`dashred.data.io.write_netcdf`."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from dashred.core.errors import InputError
from dashred.core.files.damaged_files import reading_errors
from dashred.core.files.external_links import check_hdf5
from dashred.core.stated.record_part import WHOLE, RecordPart
from dashred.core.units import TIME, check_same_unit, check_unit
from dashred.data.checks import check_covered, checked_recording, fewest_samples
from dashred.data.clocks.record_part import part_of
from dashred.data.episodes import Episode, EpisodeRows, Episodes
from dashred.data.io.dataset_inputs import inputs_of_dataset
from dashred.data.io.dataset_variables import (
    episode_rows,
    in_system_unit,
    numbers_of,
    sample_location,
    sensor_texts,
    unit_of,
)
from dashred.data.io.sensor_units import convert_sensor
from dashred.data.io.stated_units import StatedUnits
from dashred.data.sensors import Sensor, SystemDescription, check_names, check_sensor
from dashred.physics.backends.input_signals import InputSignals

if TYPE_CHECKING:
    import xarray as xr

# Limit on the declared size of a recording.
MAX_BYTES = 2**32


def read_netcdf(path: str, system: SystemDescription, part: RecordPart = WHOLE) -> Episodes:
    """Read a recording whose sensors are described in the file itself.

    Args:
        path: of the file.
        system: that was recorded.
        part: the samples that are used.

    Raises:
        InputError: the file is not NetCDF-4; a variable is missing, has the wrong dimensions or
            holds text instead of numbers; or the recording is invalid.
    """
    if not Path(path).is_file():
        raise InputError("no such file", where=path, hint=f"looked in {Path.cwd()}")
    return episodes_of_dataset(_load(path), path, system, part)


def episodes_of_dataset(
    dataset: xr.Dataset, path: str, system: SystemDescription, part: RecordPart = WHOLE
) -> Episodes:
    """Read a recording whose sensors are described in the dataset itself.

    Args:
        dataset: in the layout that ``write_netcdf`` describes.
        path: what messages call it.
        system: that was recorded.
        part: the samples that are used.

    Raises:
        InputError: as :func:`read_netcdf`.
    """
    names = sensor_texts(dataset, "name", path)
    check_names(names, path)
    stated = StatedUnits(system)
    times = in_system_unit(dataset, "time", ("time",), TIME, stated, path)
    parts = episode_rows(dataset, "episode", "time", path)
    inputs = inputs_of_dataset(dataset, stated, parts, path)
    sensors = _sensors(dataset, names, stated, path)
    values = numbers_of(dataset, "value", ("time", "sensor"), path)
    sensors, values = _convert_readings(dataset, sensors, values, stated, path)
    fewest = fewest_samples([part.count for part in parts])

    def episode(stretch: EpisodeRows, driven: InputSignals) -> Episode:
        rows, first = stretch.rows, stretch.rows.start

        def place(row: int, sensor: str | None) -> str:
            return sample_location(path, first + row, sensor)

        recording = checked_recording(
            sensors,
            times[rows],
            values[rows],
            path=stretch.location(path),
            place=place,
            fewest=fewest,
        )
        return Episode(stretch.name, replace(recording, inputs=driven, units=stated.units))

    chosen = part_of(Episodes(tuple(map(episode, parts, inputs))), part, path)
    where = {stretch.name: f"{stretch.location(path)}, 'input_time'" for stretch in parts}
    for found in chosen.episodes:
        recording = found.recording
        if recording.inputs.values:
            check_covered(recording.times, recording.inputs.times, where[found.name])
    return chosen


def _convert_readings(
    dataset: xr.Dataset,
    sensors: list[Sensor],
    values: NDArray[np.float64],
    stated: StatedUnits,
    path: str,
) -> tuple[list[Sensor], NDArray[np.float64]]:
    """Convert readings and noise to the units of the system.

    The units are in the attribute ``units`` of the values and in the variable ``unit``.
    """
    whole, unit_of_std = (unit_of(dataset, name, path) for name in ("value", "std"))
    own = (
        sensor_texts(dataset, "unit", path) if "unit" in dataset.variables else [""] * len(sensors)
    )
    converted, columns = [], []
    for sensor, text, column in zip(sensors, own, values.T, strict=True):
        what, unit, where = f"sensor {sensor.name!r}", whole, f"{path}, 'value'"
        if text:
            unit, where = text, f"{path}, 'unit' of {what}"
            unit = check_unit(unit, what, where)
            if whole is not None:
                check_same_unit(what, unit, where, whole, f"{path}, 'value'")
        own_sensor, convert = convert_sensor(
            sensor, unit, where, unit_of_std, f"{path}, 'std'", stated
        )
        converted.append(own_sensor)
        columns.append(convert(column))
    return converted, np.stack(columns, axis=1) if columns else values


def _load(path: str) -> xr.Dataset:
    with reading_errors("NetCDF-4 file", path):
        # Imported here, because they take a second. h5netcdf is imported explicitly, because
        # xarray's error for a missing engine does not name it.
        import h5netcdf  # noqa: F401
        import xarray as xr

        # Checked first: h5netcdf prints a traceback when it fails on a damaged object.
        check_hdf5(path)
        # Times are not decoded to dates: t is the recording's own clock.
        with xr.open_dataset(path, engine="h5netcdf", decode_times=False) as dataset:
            # A file of a few bytes may declare any size.
            if dataset.nbytes > MAX_BYTES:
                problem = f"the file declares {dataset.nbytes} bytes; the limit is {MAX_BYTES}"
                raise InputError(problem, where=path)
            return dataset.load()


def _sensors(dataset: xr.Dataset, names: list[str], stated: StatedUnits, path: str) -> list[Sensor]:
    system = stated.system
    reads = sensor_texts(dataset, "reads", path)
    stds = np.full(len(names), np.nan)
    if "std" in dataset.variables:
        stds = numbers_of(dataset, "std", ("sensor",), path)
    places = [
        in_system_unit(dataset, axis.name, ("sensor",), axis.name, stated, path)
        for axis in system.axes
    ]
    widths = [
        in_system_unit(dataset, column, ("sensor",), axis.name, stated, path)
        if (column := f"{axis.name}_width") in dataset.variables
        else np.zeros(len(names))
        for axis in system.axes
    ]
    sensors = []
    for index, name in enumerate(names):
        region = tuple(float(width[index]) for width in widths)
        position = tuple(float(place[index]) for place in places)
        std = None if math.isnan(stds[index]) else float(stds[index])
        widened = region if any(region) else ()
        sensors.append(Sensor(name, reads[index], position, std, widths=widened))
        check_sensor(sensors[-1], system, path)
    return sensors
