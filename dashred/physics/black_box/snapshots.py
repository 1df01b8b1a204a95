"""Snapshots of a black-box simulator in NetCDF or Zarr, read on demand."""

from __future__ import annotations

from dataclasses import dataclass
from hashlib import sha256
from typing import TYPE_CHECKING

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from dashred.core.errors import InputError
from dashred.core.files.damaged_files import reading_errors
from dashred.physics.system import System

if TYPE_CHECKING:
    import xarray as xr

# Relative deviation from a whole number of steps that is allowed.
CLOCK_TOLERANCE = 1e-3
DAMAGED = "the file is damaged: copy or write it again"


@dataclass(frozen=True, eq=False)
class Snapshots:
    """An open file of snapshots, of which only the coordinates have been read.

    Attributes:
        path: of the file or folder.
        system: with the fields and the grid.
        dataset: the open file.
        members: number of runs.
        samples: number of samples per run.
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
            every: the configured step; None takes the shortest possible step.

        Raises:
            InputError: the configured step is not a multiple of the step between snapshots.
        """
        wanted = max(own, self.step) if every is None else every
        count = round(wanted / self.step)
        if count >= 1 and abs(wanted / self.step - count) <= CLOCK_TOLERANCE * count:
            return wanted
        longer = max(1, int(np.ceil(own / self.step))) * self.step
        if every is None:
            return longer
        raise InputError(
            f"a step of {every:g} is not a multiple of the snapshots' step, {self.step:.6g}",
            where="recording.every",
            hint=f"set recording.every to null or to {longer:.6g}",
        )

    def stride(self, every: float) -> int:
        """Return the number of steps between snapshots in one step of the clock."""
        return round(every / self.step)

    def samples_at(self, every: float) -> int:
        """Return the number of samples per run at the step of the clock."""
        return -(-self.samples // self.stride(every))

    def read(self, members: int, every: float, rng: np.random.Generator) -> tuple[Tensor, str]:
        """Read random runs at the step of the clock.

        Args:
            members: maximum number of runs.
            every: step of the clock, a multiple of the step between snapshots.
            rng: draws the runs and their order.

        Returns:
            States ``(member, time, field, *grid)``, float64, and the hash of the values.

        Raises:
            InputError: the file is damaged, or a value is not finite.
        """
        stride, kept = self.stride(every), self.samples_at(every)
        chosen = rng.permutation(self.members)[:members]
        shape = tuple(axis.own_points for axis in self.system.axes)
        states = torch.empty((len(chosen), kept, len(self.system.fields), *shape)).double()
        digest = sha256()
        for row, member in enumerate(chosen.tolist()):
            for index, field in enumerate(self.system.fields):
                values = self.values(field, member, slice(None, None, stride))
                digest.update(np.ascontiguousarray(values, "<f8").tobytes())
                states[row, :, index] = torch.from_numpy(values)
        return self.system.grid.ring(states), digest.hexdigest()

    def values(self, field: str, member: int, samples: slice) -> Float[np.ndarray, "time ..."]:
        """Read one field of a run, ``(time, *points)``, float64.

        Args:
            field: name of the field.
            member: number of the run.
            samples: the samples of the run, with their stride.

        Raises:
            InputError: the file is damaged, or a value is not finite.
        """
        axes = [axis.name for axis in self.system.axes]
        part = self.dataset.isel({"member": member, "time": samples}, missing_dims="ignore")
        with reading_errors("file of snapshots", self.path, DAMAGED):
            values = np.asarray(part[field].transpose("time", *axes).values, np.float64)
        bad = ~np.isfinite(values).reshape(len(values), -1).all(axis=1)
        if bad.any():
            read = range(self.samples)[samples]
            raise InputError(
                f"{field} is not finite in member {member}, sample {read[int(bad.argmax())]} "
                "(counted from 0)",
                where=self.path,
                hint="remove this run from the file, or end all runs before that time",
            )
        return values
