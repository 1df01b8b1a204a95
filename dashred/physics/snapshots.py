"""Runs of a simulator that nothing else is known of: NetCDF or Zarr, read as far as is needed."""

from __future__ import annotations

import os
from dataclasses import dataclass
from hashlib import sha256
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from dashred.errors import InputError, nearest
from dashred.outside_links import check_folder, check_hdf5
from dashred.physics.grid import Axis
from dashred.physics.system import System
from dashred.units import TIME, check_same, check_unit

if TYPE_CHECKING:
    import xarray as xr

# A step may miss the mean step by so much of it: files keep times in single precision, too.
UNEVEN = 1e-3
# The step of a clock that is so much of a step off a whole number of snapshots lies on them.
ON_CLOCK = 1e-3
# Coordinates may miss the grid's by so much of a spacing.
OFF_GRID = 1e-3
# Where a unit of a name is stated.
UNITS_KEY = "system.units.{}"
# What is read may take this share of the machine's memory: training needs several times as much.
MEMORY = 0.15


@dataclass(frozen=True, eq=False)
class Snapshots:
    """What a file of snapshots holds, of which nothing but coordinates has been read.

    Attributes:
        path: the file or folder.
        system: whose fields and grid they are.
        dataset: the file, open.
        members: runs in it.
        samples: of each run.
        step: between samples, in the system's unit of time.
    """

    path: str
    system: System
    dataset: xr.Dataset
    members: int
    samples: int
    step: float

    def clock_step(self, own: float, every: float | None) -> float:
        """Return the step of the analysis clock: a whole number of steps between snapshots.

        Args:
            own: the recording's own step.
            every: the step that the user asks for; None takes the shortest that both allow.

        Raises:
            InputError: snapshots do not lie on the step that the user asks for.
        """
        wanted = max(own, self.step) if every is None else every
        count = round(wanted / self.step)
        if count >= 1 and abs(wanted / self.step - count) <= ON_CLOCK * count:
            return wanted
        longer = max(1, int(np.ceil(own / self.step))) * self.step
        if every is None:
            return longer
        raise InputError(
            f"a step of {every:g} is no whole number of the snapshots' steps, {self.step:.6g}",
            where="recording.every",
            hint=f"set recording.every to null or to {longer:.6g}",
        )

    def stride(self, every: float) -> int:
        """Return how many of its steps a step of the clock is."""
        return round(every / self.step)

    def samples_at(self, every: float) -> int:
        """Return samples of each run at the clock's step."""
        return -(-self.samples // self.stride(every))

    def read(self, members: int, every: float, rng: np.random.Generator) -> tuple[Tensor, str]:
        """Read so many runs, drawn at random, at the clock's step.

        Args:
            members: how many runs at most.
            every: the clock's step, a whole number of the snapshots' own.
            rng: draws them, and their order.

        Returns:
            ``(member, time, field, *grid)``, float64, and the hash of what was read.

        Raises:
            InputError: a value is not finite, or it would not fit into memory.
        """
        stride, kept = self.stride(every), self.samples_at(every)
        chosen = rng.permutation(self.members)[:members]
        self._check_memory(len(chosen), kept)
        axes = [axis.name for axis in self.system.axes]
        shape = tuple(axis.own_points for axis in self.system.axes)
        states = torch.empty((len(chosen), kept, len(self.system.fields), *shape)).double()
        digest = sha256()
        for row, member in enumerate(chosen.tolist()):
            indices = {"member": member, "time": slice(None, None, stride)}
            part = self.dataset.isel(indices, missing_dims="ignore")
            for index, field in enumerate(self.system.fields):
                values = np.asarray(part[field].transpose("time", *axes).values, np.float64)
                self._check_finite(values, field, member, stride)
                digest.update(np.ascontiguousarray(values, "<f8").tobytes())
                states[row, :, index] = torch.from_numpy(values)
        return self.system.grid.ring(states), digest.hexdigest()

    def _check_memory(self, members: int, samples: int) -> None:
        points = int(np.prod(self.system.grid.shape)) * len(self.system.fields)
        size = 8 * members * samples * points
        limit = MEMORY * os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")
        if size > limit:
            fitting = int(members * limit / size)
            raise InputError(
                f"{members} runs of {samples} snapshots would take {size / 1e9:.3g} GB, more than "
                f"the {limit / 1e9:.3g} GB that this machine can spare",
                where=self.path,
                hint=f"lower simulation.members (to {fitting} or less) or raise recording.every",
            )

    def _check_finite(
        self, values: Float[np.ndarray, "time ..."], field: str, member: int, stride: int
    ) -> None:
        bad = ~np.isfinite(values).reshape(len(values), -1).all(axis=1)
        if bad.any():
            sample = int(np.flatnonzero(bad)[0]) * stride
            raise InputError(
                f"{field} is not finite in member {member}, sample {sample} (counted from 0)",
                where=self.path,
                hint="leave this run out of the file, or end all runs before that time",
            )


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
    try:
        (check_folder if engine == "zarr" else check_hdf5)(path)
        # Arrays stay on disk until they are indexed; times stay the numbers they are.
        return xr.open_dataset(path, engine=engine, chunks=None, decode_times=False)
    except InputError:
        raise
    except Exception as error:  # a damaged file fails in as many ways as its format has layers
        reason = str(error).splitlines()[0] if str(error) else type(error).__name__
        kind = "Zarr folder" if engine == "zarr" else "NetCDF-4 file"
        hint = "snapshots are one NetCDF-4 file or one Zarr folder, such as xarray writes"
        raise InputError(f"not a readable {kind}: {reason}", where=path, hint=hint) from error


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
            check_same(variable, unit, where, system.units.get(name), UNITS_KEY.format(name))


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
