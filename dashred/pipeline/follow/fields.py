"""Write whole fields at intervals, to NetCDF or Zarr."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from dashred.core.files.atomic import write_netcdf_atomic
from dashred.core.units import TIME
from dashred.physics.system import System
from dashred.pipeline.follow.output_paths import ZARR

Array = NDArray[np.float64]

# Number of fields that are written at once.
BLOCK = 16
METHODS = ("filter", "shred")


class FieldFile:
    """Fields of both estimators over ``(method, time, *axes)``.

    A Zarr grows in place. A NetCDF is written whole, so that it is never half-written: for a long
    stream Zarr is better.

    Args:
        path: the file.
        system: the simulator.
    """

    def __init__(self, path: Path, system: System) -> None:
        self._path, self._system = path, system
        self._is_zarr = path.suffix.lower() == ZARR
        self._waiting: list[tuple[float, Array]] = []
        self._earlier: list[xr.Dataset] = []
        self._has_written = False

    def add(self, time: float, filtered: Array, shred: Array) -> None:
        """Add the fields of one time, ``(field, *point)`` each."""
        self._waiting.append((time, np.stack([filtered, shred])))
        if len(self._waiting) >= BLOCK:
            self.flush()

    def flush(self) -> None:
        """Write the fields that are waiting."""
        if not self._waiting:
            return
        block = self._dataset()
        self._waiting = []
        if self._is_zarr:
            if self._has_written:
                block.to_zarr(self._path, append_dim="time", consolidated=False)
            else:
                block.to_zarr(self._path, mode="w-", consolidated=False)
        else:
            self._earlier.append(block)
            write_netcdf_atomic(self._path, xr.concat(self._earlier, dim="time"))
        self._has_written = True

    def _dataset(self) -> xr.Dataset:
        system = self._system
        times = [time for time, _ in self._waiting]
        # (method, time, field, *point)
        values = np.stack([fields for _, fields in self._waiting], axis=1)

        def unit(name: str) -> dict[str, str]:
            return {"units": system.units[name]} if name in system.units else {}

        dims = ("method", "time", *system.grid.dimensions)
        return xr.Dataset(
            {
                name: (dims, np.ascontiguousarray(values[:, :, index]), unit(name))
                for index, name in enumerate(system.fields)
            },
            {
                "method": ("method", list(METHODS)),
                "time": ("time", times, unit(TIME)),
                **{
                    name: (along, x.numpy(), unit(name))
                    for name, (along, x) in system.grid.labels.items()
                },
            },
        )
