"""Variables of a dataset in the layout of :mod:`.write_netcdf`, with their checks and units."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from dashred.core.errors import InputError, nearest
from dashred.core.units import TIME, check_unit
from dashred.data.episodes import EpisodeRows, split_into_episodes
from dashred.data.io.stated_units import StatedUnits
from dashred.data.io.tables.csv_table import SECONDS_AS_NUMBERS

if TYPE_CHECKING:
    import xarray as xr


def in_system_unit(
    dataset: xr.Dataset,
    variable: str,
    dims: tuple[str, ...],
    name: str,
    stated: StatedUnits,
    path: str,
) -> NDArray[np.float64]:
    """Return a variable in the unit that the system states for a name."""
    what, where = "time" if name == TIME else name, f"{path}, {variable!r}"
    unit = unit_of(dataset, variable, path)
    if unit is None and variable == "input_time":
        # Both clocks count in one unit, unless they say otherwise.
        unit = unit_of(dataset, "time", path)
    convert = stated.state(name, unit, where, what)
    return convert(numbers_of(dataset, variable, dims, path))


def numbers_of(
    dataset: xr.Dataset, name: str, dims: Sequence[str], path: str
) -> NDArray[np.float64]:
    """Return a variable as numbers, with the given dimensions."""
    values = variable_of(dataset, name, dims, path).values
    if values.dtype.kind not in "fiu":
        dated = values.dtype.kind in "Mm"
        problem = f"{name!r} does not hold numbers: its dtype is {values.dtype}"
        raise InputError(problem, where=path, hint=SECONDS_AS_NUMBERS if dated else None)
    # A copy: what is in memory may be changed by its owner.
    return np.array(values, dtype=np.float64, order="C")


def sensor_texts(dataset: xr.Dataset, name: str, path: str) -> list[str]:
    """Return a variable with a text for every sensor."""
    values = variable_of(dataset, name, ("sensor",), path).values
    return [decoded(value, name, path) for value in values]


def decoded(value: object, name: str, path: str) -> str:
    """Return a value as text; character arrays are bytes, padded with blanks or zeros."""
    if not isinstance(value, bytes):
        return str(value)
    try:
        return value.rstrip(b" \0").decode()
    except UnicodeDecodeError:
        raise InputError(f"{name!r} holds text that is not UTF-8", where=path) from None


def unit_of(dataset: xr.Dataset, variable: str, path: str) -> str | None:
    """Return the attribute ``units`` of a variable, or None if it is empty.

    Of ``seconds since 2020-01-01``, the unit is ``seconds``.
    """
    if variable not in dataset.variables:
        return None
    text = str(dataset[variable].attrs.get("units", "")).partition(" since ")[0]
    return check_unit(text, variable, f"{path}, {variable!r}") if text.strip() else None


def variable_of(dataset: xr.Dataset, name: str, dims: Sequence[str], path: str) -> xr.DataArray:
    """Return a variable with the given dimensions.

    Raises:
        InputError: there is none, or it has other dimensions.
    """
    if name not in dataset.variables:
        hint = nearest(name, (str(found) for found in dataset.variables))
        raise InputError(f"the recording has no variable {name!r}", where=path, hint=hint)
    if dataset[name].dims != tuple(dims):
        found = ", ".join(str(dim) for dim in dataset[name].dims)
        problem = f"{name!r} has the dimensions ({found}) instead of ({', '.join(dims)})"
        raise InputError(problem, where=path)
    return dataset[name]


def episode_rows(dataset: xr.Dataset, name: str, clock: str, path: str) -> list[EpisodeRows]:
    """Return the samples of every episode; without the variable, one episode with all samples."""
    count = dataset.sizes[clock]
    if name not in dataset.variables or not count:
        return [EpisodeRows("", slice(0, count))]
    labels = variable_of(dataset, name, (clock,), path).values
    if labels.dtype.kind not in "OUSiu":
        raise InputError(f"{name!r} must hold names or integers", where=path)
    texts = [decoded(label, name, path) for label in labels]
    return split_into_episodes(texts, lambda sample: sample_location(path, sample, name))


def sample_location(path: str, sample: int, variable: str | None) -> str:
    """Return the place of a value for messages: ``rec.nc, sample 4, 'u'``."""
    return f"{path}, sample {sample + 1}" + (f", {variable!r}" if variable else "")
