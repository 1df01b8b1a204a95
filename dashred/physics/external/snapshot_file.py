"""A file of snapshots, opened and held against the system's fields, grid and units."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from dashred.core.errors import InputError, nearest
from dashred.core.files.damaged_files import reading_errors
from dashred.core.files.external_links import check_folder, check_hdf5
from dashred.core.units import TIME, check_same_unit, check_unit
from dashred.physics.external.snapshots import Snapshots
from dashred.physics.grids.grid import Axis
from dashred.physics.system import System

if TYPE_CHECKING:
    import xarray as xr

# A step may miss the mean step by so much of it: files keep times in single precision, too.
UNEVEN = 1e-3
# Coordinates may miss the grid's by so much of a spacing.
OFF_GRID = 1e-3
FORMATS = "snapshots are one NetCDF-4 file or one Zarr folder, such as xarray writes"
# Where a unit of a name is stated.
UNITS_KEY = "system.units.{}"


def open_snapshots(path: str, system: System) -> Snapshots:
    """Open a file of snapshots and hold it against the system's fields and grid.

    A file without the dimension ``member`` holds one run.

    Raises:
        InputError: it cannot be read, a field is missing, the dimensions or coordinates are not
            the grid's, times are not even, or a unit is another than is stated elsewhere.
    """
    dataset = _open(path)
    for field in system.fields:
        _check_variable(dataset, field, system, path)
    for axis in system.axes:
        _check_axis(dataset, axis, path)
    _check_units(dataset, system, path)
    sizes = dataset.sizes
    if sizes["time"] < 2:
        raise InputError("a run needs two snapshots at least", where=path)
    step = _step(dataset, path)
    return Snapshots(path, system, dataset, sizes.get("member", 1), sizes["time"], step)


def _open(path: str) -> xr.Dataset:
    import xarray as xr

    if not Path(path).exists():
        raise InputError("no such file or folder", where=path, hint=f"looked in {Path.cwd()}")
    engine = "zarr" if Path(path).is_dir() else "h5netcdf"
    kind = "Zarr folder" if engine == "zarr" else "NetCDF-4 file"
    with reading_errors(kind, path, FORMATS):
        # Of an engine that is not installed xarray says nothing that names it.
        if engine == "zarr":
            import zarr  # noqa: F401
        else:
            import h5netcdf  # noqa: F401
        (check_folder if engine == "zarr" else check_hdf5)(path)
        # Arrays stay on disk until they are indexed; times stay the numbers they are.
        return xr.open_dataset(path, engine=engine, chunks=None, decode_times=False)


def _check_variable(dataset: xr.Dataset, field: str, system: System, path: str) -> None:
    if field not in dataset.data_vars:
        hint = nearest(field, map(str, dataset.data_vars))
        raise InputError(f"the snapshots have no variable {field!r}", where=path, hint=hint)
    runs = ("member",) if "member" in dataset.dims else ()
    wanted = (*runs, "time", *(axis.name for axis in system.axes))
    found = tuple(map(str, dataset[field].dims))
    if set(found) != set(wanted):
        what = f"{field!r} has the dimensions ({', '.join(found)}), not ({', '.join(wanted)})"
        hint = "rename them (xarray: dataset.rename), or declare the axes: system.axes"
        raise InputError(what, where=path, hint=hint)
    if dataset[field].dtype.kind not in "fiu":
        raise InputError(f"{field!r} does not hold numbers", where=path)


def _check_axis(dataset: xr.Dataset, axis: Axis, path: str) -> None:
    found, wanted = dataset.sizes[axis.name], axis.own_points
    if found != wanted:
        both = "" if axis.periodic else ", both ends among them"
        raise InputError(
            f"the snapshots have {found} points along {axis.name}, and the grid {wanted}{both}",
            where=path,
            hint=f"set system.axes.{axis.name}.points to {found - (not axis.periodic)}",
        )
    if axis.name not in dataset.coords:
        return
    places = np.asarray(dataset[axis.name].values)
    grid = axis.spacing * np.arange(wanted)
    # A NaN is not near either.
    if places.dtype.kind not in "fiu" or not np.all(
        np.abs(places - grid) <= OFF_GRID * axis.spacing
    ):
        told = f"{places[0]:g} to {places[-1]:g}" if places.dtype.kind in "fiu" else "text"
        raise InputError(
            f"the coordinate {axis.name} ({told}) does not fit the grid, which has equal steps "
            f"from 0 to {grid[-1]:g}",
            where=path,
            hint=f"check system.axes.{axis.name}: length, points and ends; or interpolate the "
            "snapshots to such a grid (xarray: dataset.interp)",
        )


def _check_units(dataset: xr.Dataset, system: System, path: str) -> None:
    """Hold attributes ``units`` against what the configuration and the recording state."""
    named = {name: name for name in (*system.fields, *(axis.name for axis in system.axes))}
    for variable, name in {**named, "time": TIME}.items():
        if variable not in dataset.variables:
            continue
        text = str(dataset[variable].attrs.get("units", "")).partition(" since ")[0]
        if text.strip():
            where = f"{path}, {variable!r}"
            unit = check_unit(text, variable, where)
            check_same_unit(variable, unit, where, system.units.get(name), UNITS_KEY.format(name))


def _step(dataset: xr.Dataset, path: str) -> float:
    if "time" not in dataset.coords:
        raise InputError("the snapshots have no coordinate 'time'", where=path)
    times = np.asarray(dataset["time"].values)
    if times.dtype.kind not in "fiu" or not np.isfinite(times).all():
        raise InputError("'time' does not hold numbers alone", where=path)
    steps = np.diff(times.astype(np.float64))
    step = float(steps.mean())
    # Each time against the even clock: single precision may not be mistaken for unevenness.
    off = np.abs(times - times[0] - step * np.arange(len(times)))
    if step <= 0 or off.max() > max(UNEVEN, 1e-6 * len(times)) * step:
        sample = int(np.argmax(np.abs(steps - step)))
        raise InputError(
            f"'time' is not even: {times[sample]:g} and {times[sample + 1]:g} follow each other, "
            f"where the step is {step:g} on average",
            where=path,
            hint="interpolate the snapshots to equal steps (xarray: dataset.interp)",
        )
    return step
