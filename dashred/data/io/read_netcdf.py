"""Reader of NetCDF recordings, in the layout of :mod:`dashred.data.io.write_netcdf`."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from dashred.core.errors import InputError, nearest
from dashred.core.files.damaged_files import reading_errors
from dashred.core.files.external_links import check_hdf5
from dashred.core.stated.record_part import WHOLE, RecordPart
from dashred.core.units import TIME, check_same_unit, check_unit
from dashred.data.checks import (
    check_covered,
    check_input,
    checked_recording,
    fewest_samples,
)
from dashred.data.clocks.record_part import part_of
from dashred.data.episodes import Episode, EpisodeRows, Episodes, split_into_episodes
from dashred.data.io.sensor_units import convert_sensor
from dashred.data.io.stated_units import StatedUnits
from dashred.data.io.tables.csv_table import SECONDS_AS_NUMBERS
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
    names = _texts(dataset, "name", path)
    check_names(names, path)
    stated = StatedUnits(system)
    times = _converted(dataset, "time", ("time",), TIME, stated, path)
    parts = _episode_rows(dataset, "episode", "time", path)
    inputs = _inputs(dataset, stated, parts, path)
    sensors = _sensors(dataset, names, stated, path)
    values = _numbers(dataset, "value", ("time", "sensor"), path)
    sensors, values = _convert_readings(dataset, sensors, values, stated, path)
    fewest = fewest_samples([part.count for part in parts])

    def episode(stretch: EpisodeRows, driven: InputSignals) -> Episode:
        rows, first = stretch.rows, stretch.rows.start

        def place(row: int, sensor: str | None) -> str:
            return _location(path, first + row, sensor)

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
    whole, unit_of_std = (_attribute(dataset, name, path) for name in ("value", "std"))
    own = _texts(dataset, "unit", path) if "unit" in dataset.variables else [""] * len(sensors)
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


def _converted(
    dataset: xr.Dataset,
    variable: str,
    dims: tuple[str, ...],
    name: str,
    stated: StatedUnits,
    path: str,
) -> NDArray[np.float64]:
    """Return a variable in the unit that the system states for a name."""
    what, where = "time" if name == TIME else name, f"{path}, {variable!r}"
    unit = _attribute(dataset, variable, path)
    if unit is None and variable == "input_time":
        # Both clocks count in one unit, unless they say otherwise.
        unit = _attribute(dataset, "time", path)
    convert = stated.state(name, unit, where, what)
    return convert(_numbers(dataset, variable, dims, path))


def _attribute(dataset: xr.Dataset, variable: str, path: str) -> str | None:
    """Return the attribute ``units`` of a variable, or None if it is empty.

    Of ``seconds since 2020-01-01``, the unit is ``seconds``.
    """
    if variable not in dataset.variables:
        return None
    text = str(dataset[variable].attrs.get("units", "")).partition(" since ")[0]
    return check_unit(text, variable, f"{path}, {variable!r}") if text.strip() else None


def _check_epochs(dataset: xr.Dataset, path: str) -> None:
    """Check that the clocks of samples and inputs have the same epoch.

    Raises:
        InputError: the epochs differ.
    """
    since = [_since(dataset, clock) for clock in ("time", "input_time")]
    if all(since) and _moment(since[0]) != _moment(since[1]):
        problem = f"'input_time' counts since {since[1]}, but 'time' counts since {since[0]}"
        hint = "use the same epoch for both: times are not converted"
        raise InputError(problem, where=f"{path}, 'input_time'", hint=hint)


def _since(dataset: xr.Dataset, clock: str) -> str:
    """Return the epoch in ``seconds since 2020-01-01``, or '' if there is none."""
    return str(dataset[clock].attrs.get("units", "")).partition(" since ")[2].strip()


def _moment(text: str) -> datetime | str:
    """Return an epoch as a datetime, or the text itself if it is not an ISO date."""
    try:
        moment = datetime.fromisoformat(text)
    except ValueError:
        return " ".join(text.split())
    return moment if moment.tzinfo else moment.replace(tzinfo=UTC)


def _location(path: str, sample: int, variable: str | None) -> str:
    return f"{path}, sample {sample + 1}" + (f", {variable!r}" if variable else "")


def _episode_rows(dataset: xr.Dataset, name: str, clock: str, path: str) -> list[EpisodeRows]:
    """Return the samples of every episode; without the variable, one episode with all samples."""
    count = dataset.sizes[clock]
    if name not in dataset.variables or not count:
        return [EpisodeRows("", slice(0, count))]
    labels = _variable(dataset, name, (clock,), path).values
    if labels.dtype.kind not in "OUSiu":
        raise InputError(f"{name!r} must hold names or integers", where=path)
    texts = [_text(label, name, path) for label in labels]
    return split_into_episodes(texts, lambda sample: _location(path, sample, name))


def _inputs(
    dataset: xr.Dataset, stated: StatedUnits, parts: Sequence[EpisodeRows], path: str
) -> list[InputSignals]:
    """Return the inputs of every episode by column, on their own or on the recording's clock."""
    clock, input_parts = "time", list(parts)
    if "input_time" in dataset.variables:
        clock = "input_time"
        input_parts = _episode_rows(dataset, "input_episode", "input_time", path)
    names = [[part.name for part in found] for found in (parts, input_parts)]
    if len(parts) != len(input_parts) or (len(parts) > 1 and names[0] != names[1]):
        problem = "the inputs and the samples have different episodes"
        hint = "use the same episodes in the same order for both"
        raise InputError(problem, where=f"{path}, 'input_episode'", hint=hint)
    system = stated.system
    times = _converted(dataset, clock, (clock,), TIME, stated, path)
    columns = {
        column: _converted(dataset, column, (clock,), name, stated, path)
        for name, column in system.inputs.items()
    }
    for name, column in system.inputs.items():
        check_input(name, column, columns[column], lambda at, of: _location(path, at, of))
    # The recording's own clock is checked with the samples.
    if clock == "input_time" and system.inputs:
        _check_epochs(dataset, path)
        for part in input_parts:
            own = times[part.rows]
            if not np.all(np.isfinite(own)) or not np.all(np.diff(own) > 0):
                raise InputError(f"{clock!r} does not increase", where=part.location(path))
    return [
        InputSignals(times[part.rows], {name: found[part.rows] for name, found in columns.items()})
        for part in input_parts
    ]


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


def _variable(dataset: xr.Dataset, name: str, dims: Sequence[str], path: str) -> xr.DataArray:
    if name not in dataset.variables:
        hint = nearest(name, (str(found) for found in dataset.variables))
        raise InputError(f"the recording has no variable {name!r}", where=path, hint=hint)
    if dataset[name].dims != tuple(dims):
        found = ", ".join(str(dim) for dim in dataset[name].dims)
        problem = f"{name!r} has the dimensions ({found}) instead of ({', '.join(dims)})"
        raise InputError(problem, where=path)
    return dataset[name]


def _texts(dataset: xr.Dataset, name: str, path: str) -> list[str]:
    values = _variable(dataset, name, ("sensor",), path).values
    return [_text(value, name, path) for value in values]


def _text(value: object, name: str, path: str) -> str:
    """Return a value as text; character arrays are bytes, padded with blanks or zeros."""
    if not isinstance(value, bytes):
        return str(value)
    try:
        return value.rstrip(b" \0").decode()
    except UnicodeDecodeError:
        raise InputError(f"{name!r} holds text that is not UTF-8", where=path) from None


def _numbers(dataset: xr.Dataset, name: str, dims: Sequence[str], path: str) -> NDArray[np.float64]:
    values = _variable(dataset, name, dims, path).values
    if values.dtype.kind not in "fiu":
        dated = values.dtype.kind in "Mm"
        problem = f"{name!r} does not hold numbers: its dtype is {values.dtype}"
        raise InputError(problem, where=path, hint=SECONDS_AS_NUMBERS if dated else None)
    # A copy: what is in memory may be changed by its owner.
    return np.array(values, dtype=np.float64, order="C")


def _sensors(dataset: xr.Dataset, names: list[str], stated: StatedUnits, path: str) -> list[Sensor]:
    system = stated.system
    reads = _texts(dataset, "reads", path)
    stds = np.full(len(names), np.nan)
    if "std" in dataset.variables:
        stds = _numbers(dataset, "std", ("sensor",), path)
    places = [
        _converted(dataset, axis.name, ("sensor",), axis.name, stated, path) for axis in system.axes
    ]
    widths = [
        _converted(dataset, column, ("sensor",), axis.name, stated, path)
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
