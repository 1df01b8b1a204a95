"""Opening of a file of snapshots, with checks of fields, grid, times and units."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from dashred.core.errors import InputError, nearest
from dashred.core.files.damaged_files import reading_errors
from dashred.core.files.external_links import check_folder, check_hdf5
from dashred.core.units import TIME, check_same_unit, check_unit
from dashred.physics.black_box.snapshots import Snapshots
from dashred.physics.grids.grid import Axis
from dashred.physics.system import System

if TYPE_CHECKING:
    import xarray as xr

# Relative variation of time steps that is allowed, because times may be in single precision.
MAX_STEP_VARIATION = 1e-3
# Allowed deviation of coordinates from the grid, as a share of the spacing.
GRID_TOLERANCE = 1e-3
FORMATS = "snapshots are one NetCDF-4 file or one Zarr folder, such as xarray writes"
# Configuration key of the unit of a name.
UNITS_KEY = "system.units.{}"


def open_snapshots(path: str, system: System) -> Snapshots:
    """Open a file of snapshots and check it against the system.

    A file without the dimension ``member`` holds one run.

    Raises:
        InputError: the file cannot be read, a field is missing, the dimensions or coordinates do
            not fit the grid, times are uneven, or a unit differs from the configuration.
    """
    dataset = _open(path)
    for field in system.fields:
        _check_variable(dataset, field, system, path)
        if Path(path).is_dir():
            _check_chunks(field, path)
    for axis in system.axes:
        _check_axis(dataset, axis, path)
    _check_units(dataset, system, path)
    sizes = dataset.sizes
    if sizes["time"] < 2:
        raise InputError("a run needs at least two snapshots", where=path)
    step = _step(dataset, path)
    return Snapshots(path, system, dataset, sizes.get("member", 1), sizes["time"], step)


def _open(path: str) -> xr.Dataset:
    import xarray as xr

    if not Path(path).exists():
        raise InputError("no such file or folder", where=path, hint=f"looked in {Path.cwd()}")
    engine = "zarr" if Path(path).is_dir() else "h5netcdf"
    kind = "Zarr folder" if engine == "zarr" else "NetCDF-4 file"
    with reading_errors(kind, path, FORMATS):
        # Imported explicitly, because xarray's error for a missing engine does not name it.
        if engine == "zarr":
            import zarr  # noqa: F401
        else:
            import h5netcdf  # noqa: F401
        (check_folder if engine == "zarr" else check_hdf5)(path)
        # Arrays stay on disk until they are indexed; times are not decoded to dates. The metadata
        # of a few arrays need no copy in one place, which not every store has.
        options: dict[str, Any] = {"consolidated": False} if engine == "zarr" else {}
        return xr.open_dataset(path, engine=engine, chunks=None, decode_times=False, **options)


def _check_variable(dataset: xr.Dataset, field: str, system: System, path: str) -> None:
    if field not in dataset.data_vars:
        hint = nearest(field, map(str, dataset.data_vars))
        raise InputError(f"the snapshots have no variable {field!r}", where=path, hint=hint)
    runs = ("member",) if "member" in dataset.dims else ()
    wanted = (*runs, "time", *(axis.name for axis in system.axes))
    found = tuple(map(str, dataset[field].dims))
    if set(found) != set(wanted):
        dims = f"({', '.join(found)}) instead of ({', '.join(wanted)})"
        what = f"{field!r} has the dimensions {dims}"
        hint = "rename them (xarray: dataset.rename), or declare the axes: system.axes"
        raise InputError(what, where=path, hint=hint)
    if dataset[field].dtype.kind not in "fiu":
        raise InputError(f"{field!r} does not hold numbers", where=path)


def _check_chunks(field: str, path: str) -> None:
    """Refuse an array with missing chunks: Zarr would read them as its fill value, such as 0."""
    import zarr

    with reading_errors("Zarr folder", path, FORMATS):
        array = zarr.open_array(path, path=field, mode="r")
        missing = array.nchunks - array.nchunks_initialized
    if missing:
        raise InputError(
            f"{missing} of {array.nchunks} chunks of {field!r} are missing in this Zarr folder",
            where=path,
            hint="write it again; chunks that hold one value everywhere are left out unless "
            "xarray's to_zarr is called with write_empty_chunks=True",
        )


def _check_axis(dataset: xr.Dataset, axis: Axis, path: str) -> None:
    found, wanted = dataset.sizes[axis.name], axis.own_points
    if found != wanted:
        both = "" if axis.periodic else ", including both ends"
        raise InputError(
            f"the snapshots have {found} points along {axis.name}, but the grid has {wanted}{both}",
            where=path,
            hint=f"set system.axes.{axis.name}.points to {found - (not axis.periodic)}",
        )
    if axis.name not in dataset.coords:
        return
    places = np.asarray(dataset[axis.name].values)
    grid = axis.spacing * np.arange(wanted)
    # The comparison is also false for NaN.
    if places.dtype.kind not in "fiu" or not np.all(
        np.abs(places - grid) <= GRID_TOLERANCE * axis.spacing
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
    """Compare the attributes ``units`` with the configuration."""
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
        raise InputError("'time' must hold finite numbers", where=path)
    steps = np.diff(times.astype(np.float64))
    step = float(steps.mean())
    # Compare each time with a uniform clock, so that single precision does not count as uneven.
    off = np.abs(times - times[0] - step * np.arange(len(times)))
    if step <= 0 or off.max() > max(MAX_STEP_VARIATION, 1e-6 * len(times)) * step:
        sample = int(np.argmax(np.abs(steps - step)))
        raise InputError(
            f"'time' is uneven: {times[sample]:g} is followed by {times[sample + 1]:g}, "
            f"but the mean step is {step:g}",
            where=path,
            hint="interpolate the snapshots to equal steps (xarray: dataset.interp)",
        )
    return step
