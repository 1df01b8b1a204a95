"""Reading recordings from NetCDF, in the layout that ``write_netcdf`` describes."""

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
from dashred.core.files.damaged_files import reading
from dashred.core.files.external_links import check_hdf5
from dashred.core.units import TIME, check_unit
from dashred.data.checks import check_covered, check_input, checked_recording
from dashred.data.episodes import Episode, Episodes, Stretch, stretches
from dashred.data.io.csv_table import SECONDS_AS_NUMBERS
from dashred.data.io.stated_units import StatedUnits
from dashred.data.sensors import Described, Sensor, check_names, check_sensor
from dashred.physics.backends.input_signals import Measured

if TYPE_CHECKING:
    import xarray as xr

# In bytes: what a recording may hold.
LARGEST = 2**32


def read_netcdf(path: str, system: Described) -> Episodes:
    """Read a recording whose sensors are described in the file itself.

    Raises:
        InputError: for a file that is no NetCDF-4, a variable that is missing or has other
            dimensions or text in place of numbers, or any fault of the recording itself.
    """
    if not Path(path).is_file():
        raise InputError("no such file", where=path, hint=f"looked in {Path.cwd()}")
    return episodes_of_dataset(_load(path), path, system)


def episodes_of_dataset(dataset: xr.Dataset, path: str, system: Described) -> Episodes:
    """Read a recording whose sensors are described in the dataset itself.

    Args:
        dataset: in the layout that ``write_netcdf`` describes.
        path: what messages call it.
        system: that was recorded.

    Raises:
        InputError: as :func:`read_netcdf`.
    """
    names = _texts(dataset, "name", path)
    check_names(names, path)
    sensors = _sensors(dataset, names, system, path)
    units = _units(dataset, sensors, system, path)
    times = _numbers(dataset, "time", ("time",), path)
    values = _numbers(dataset, "value", ("time", "sensor"), path)
    parts = _stretches(dataset, "episode", "time", path)
    inputs = _inputs(dataset, system, parts, path)

    def episode(stretch: Stretch, driven: Measured) -> Episode:
        rows, first = stretch.rows, stretch.rows.start

        def place(row: int, sensor: str | None) -> str:
            return _place(path, first + row, sensor)

        recording = checked_recording(
            sensors, times[rows], values[rows], path=stretch.within(path), place=place
        )
        if driven.values:
            check_covered(recording.times, driven.times, f"{stretch.within(path)}, 'input_time'")
        return Episode(stretch.name, replace(recording, inputs=driven, units=units))

    return Episodes(tuple(map(episode, parts, inputs)))


def _units(
    dataset: xr.Dataset, sensors: list[Sensor], system: Described, path: str
) -> dict[str, str]:
    """Return what attributes ``units``, and the variable ``unit`` of each sensor, state."""
    stated = StatedUnits(system)
    for name, variable in (
        (TIME, "time"),
        (TIME, "input_time"),
        *((axis.name, axis.name) for axis in system.axes),
        *system.inputs.items(),
    ):
        what = "time" if name == TIME else name
        stated.state(name, _attribute(dataset, variable, path), f"{path}, {variable!r}", what)
    whole = _attribute(dataset, "value", path)
    own = _texts(dataset, "unit", path) if "unit" in dataset.variables else [""] * len(sensors)
    for sensor, unit in zip(sensors, own, strict=True):
        what = f"sensor {sensor.name!r}"
        stated.state(sensor.reads, whole, f"{path}, 'value'", what)
        where = f"{path}, 'unit' of {what}"
        stated.state(sensor.reads, check_unit(unit, what, where) if unit else None, where, what)
    return stated.units


def _attribute(dataset: xr.Dataset, variable: str, path: str) -> str | None:
    """Return the attribute ``units`` of a variable; of ``seconds since 2020-01-01``, ``seconds``.

    An empty one states nothing.
    """
    if variable not in dataset.variables:
        return None
    text = str(dataset[variable].attrs.get("units", "")).partition(" since ")[0]
    return check_unit(text, variable, f"{path}, {variable!r}") if text.strip() else None


def _check_epochs(dataset: xr.Dataset, path: str) -> None:
    """Refuse two clocks that count from different days.

    Raises:
        InputError: with both.
    """
    since = [_since(dataset, clock) for clock in ("time", "input_time")]
    if all(since) and _moment(since[0]) != _moment(since[1]):
        problem = f"'input_time' counts since {since[1]}, and 'time' since {since[0]}"
        hint = "nothing is converted: let both count from the same moment"
        raise InputError(problem, where=f"{path}, 'input_time'", hint=hint)


def _since(dataset: xr.Dataset, clock: str) -> str:
    """Return what a clock counts from, of ``seconds since 2020-01-01`` the day; '' if unsaid."""
    return str(dataset[clock].attrs.get("units", "")).partition(" since ")[2].strip()


def _moment(text: str) -> datetime | str:
    """Return a moment, that of a time zone's in UTC; as it is written if it cannot be read."""
    try:
        moment = datetime.fromisoformat(text)
    except ValueError:
        return " ".join(text.split())
    return moment if moment.tzinfo else moment.replace(tzinfo=UTC)


def _place(path: str, sample: int, variable: str | None) -> str:
    return f"{path}, sample {sample + 1}" + (f", {variable!r}" if variable else "")


def _stretches(dataset: xr.Dataset, name: str, clock: str, path: str) -> list[Stretch]:
    """Return the samples of every episode of a clock; without the variable, all of them."""
    count = dataset.sizes[clock]
    if name not in dataset.variables or not count:
        return [Stretch("", slice(0, count))]
    labels = _variable(dataset, name, (clock,), path).values
    if labels.dtype.kind not in "OUSiu":
        raise InputError(f"{name!r} holds neither names nor whole numbers", where=path)
    texts = [_text(label, name, path) for label in labels]
    return stretches(texts, lambda sample: _place(path, sample, name))


def _inputs(
    dataset: xr.Dataset, system: Described, parts: Sequence[Stretch], path: str
) -> list[Measured]:
    """Return every episode's inputs by column: on a clock of their own, or on the recording's."""
    clock, driven = "time", list(parts)
    if "input_time" in dataset.variables:
        clock, driven = "input_time", _stretches(dataset, "input_episode", "input_time", path)
    names = [[part.name for part in found] for found in (parts, driven)]
    if len(parts) != len(driven) or (len(parts) > 1 and names[0] != names[1]):
        problem = "the inputs have other episodes than the samples"
        raise InputError(problem, where=f"{path}, 'input_episode'", hint="give both the same ones")
    times = _numbers(dataset, clock, (clock,), path)
    columns = {
        column: _numbers(dataset, column, (clock,), path) for column in system.inputs.values()
    }
    for name, column in system.inputs.items():
        check_input(name, column, columns[column], lambda at, of: _place(path, at, of))
    # The recording's own clock is looked at with the samples.
    if clock == "input_time" and system.inputs:
        _check_epochs(dataset, path)
        for part in driven:
            own = times[part.rows]
            if not np.all(np.isfinite(own)) or not np.all(np.diff(own) > 0):
                raise InputError(f"{clock!r} does not increase", where=part.within(path))
    return [
        Measured(times[part.rows], {name: found[part.rows] for name, found in columns.items()})
        for part in driven
    ]


def _load(path: str) -> xr.Dataset:
    with reading("NetCDF-4 file", path):
        # They take a second, which reading a CSV need not wait for. Of an engine that is not
        # installed xarray says nothing that names it.
        import h5netcdf  # noqa: F401
        import xarray as xr

        # First: h5netcdf leaves a traceback on stderr when a damaged object stops it halfway.
        check_hdf5(path)
        # Times stay the numbers they are: t is the recording's own clock.
        with xr.open_dataset(path, engine="h5netcdf", decode_times=False) as dataset:
            # A file of a few bytes may declare any size.
            if dataset.nbytes > LARGEST:
                problem = f"{dataset.nbytes} bytes of values are too many: {LARGEST} at most"
                raise InputError(problem, where=path)
            return dataset.load()


def _variable(dataset: xr.Dataset, name: str, dims: Sequence[str], path: str) -> xr.DataArray:
    if name not in dataset.variables:
        hint = nearest(name, (str(found) for found in dataset.variables))
        raise InputError(f"the recording has no variable {name!r}", where=path, hint=hint)
    if dataset[name].dims != tuple(dims):
        found = ", ".join(str(dim) for dim in dataset[name].dims)
        problem = f"{name!r} has the dimensions ({found}), not ({', '.join(dims)})"
        raise InputError(problem, where=path)
    return dataset[name]


def _texts(dataset: xr.Dataset, name: str, path: str) -> list[str]:
    values = _variable(dataset, name, ("sensor",), path).values
    return [_text(value, name, path) for value in values]


def _text(value: object, name: str, path: str) -> str:
    """Return a text; arrays of characters come as bytes, filled up with blanks or zeros."""
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


def _sensors(dataset: xr.Dataset, names: list[str], system: Described, path: str) -> list[Sensor]:
    reads = _texts(dataset, "reads", path)
    stds = np.full(len(names), np.nan)
    if "std" in dataset.variables:
        stds = _numbers(dataset, "std", ("sensor",), path)
    places = [_numbers(dataset, axis.name, ("sensor",), path) for axis in system.axes]
    sensors = []
    for index, name in enumerate(names):
        position = tuple(float(place[index]) for place in places)
        std = None if math.isnan(stds[index]) else float(stds[index])
        sensors.append(Sensor(name, reads[index], position, std))
        check_sensor(sensors[-1], system, path)
    return sensors
