"""A simulator that can be run from Python."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
import xarray as xr
from numpy.typing import ArrayLike
from torch import Tensor

from dashred.core.errors import InputError
from dashred.core.units import TIME
from dashred.physics.solvers.simulate import check_finite, simulate
from dashred.physics.system import System

START, TIMES = "start", "times"


@dataclass(frozen=True, eq=False)
class Simulator:
    """A simulator of the equations ``∂u/∂t = N(u, t)``.

    Attributes:
        system: equations on their grid.
        default_start: function that returns the default start, ``(field, *grid)``.
        clock: default output times, ``(time,)``. The default start is the state at the first one.
    """

    system: System
    default_start: Callable[[], Tensor]
    clock: Tensor

    @property
    def equations(self) -> dict[str, str]:
        """The right-hand sides of the equations as text, by field."""
        return dict(self.system.config.equations)

    @property
    def lets(self) -> dict[str, str]:
        """The quantities that the equations share, as text, by name."""
        return dict(self.system.config.let)

    @property
    def parameters(self) -> dict[str, float]:
        """The values of the parameters by name."""
        return dict(self.system.config.parameters)

    def simulate(
        self,
        start: xr.Dataset | Mapping[str, ArrayLike] | None = None,
        times: ArrayLike | None = None,
    ) -> xr.Dataset:
        """Run the simulator.

        Args:
            start: state at the first time: for each field a number or an array over the axes. It
                may be a Dataset, such as
                ``result.estimates.sel({"method": "corrected"}).isel(time=-1)``. None uses the
                default start at the first time of ``clock``.
            times: output times ``(time,)``, increasing, in the unit of ``t``. None uses ``clock``.

        Returns:
            The fields over ``(time, *axes)``, float64, in the units of the system.

        Raises:
            InputError: a field is missing or has the wrong shape, the times do not increase or
                begin before the start, or the simulation blows up.
        """
        output = self.clock if times is None else as_times(times)
        lead = torch.zeros(0, dtype=torch.float64)
        if start is None:
            first = self.clock[:1]
            if output[0] < first:
                what = f"the times begin at {output[0]:g}, before the start at {float(first):g}"
                raise InputError(what, where=TIMES, hint="give start=, the state at the first time")
            lead = first[first < output[:1]]
        self._check_inputs(output)
        with torch.no_grad():
            initial = self.default_start() if start is None else self._state(start)
            clock = torch.cat([lead, output])
            [states] = simulate(self.system, initial[None], clock)
            check_finite(states[None], clock, self.system)
        return self._dataset(output, states[len(lead) :])

    def _check_inputs(self, times: Tensor) -> None:
        if not self.system.inputs:
            return
        known = self.system.input_signals.times
        margin = 1e-9 * max(1.0, float(np.abs(known).max()))
        if times[0] < known[0] - margin or times[-1] > known[-1] + margin:
            what = f"the inputs are known only from {known[0]:g} to {known[-1]:g}"
            raise InputError(what, where=TIMES, hint="choose times at which the inputs are known")

    def _state(self, start: xr.Dataset | Mapping[str, ArrayLike]) -> Tensor:
        """Return a start as ``(field, *grid)``."""
        fields, grid = self.system.fields, self.system.grid
        sizes = {along: len(values) for along, values in grid.labels.values()}
        shape = tuple(sizes[along] for along in grid.dimensions)
        if not isinstance(start, Mapping):
            what = f"a start cannot be of the type {type(start).__name__}"
            raise InputError(what, where=START, hint="give a mapping from fields to values")
        names = start.data_vars if isinstance(start, xr.Dataset) else start
        if unknown := [str(name) for name in names if name not in fields]:
            hint = f"the fields are {', '.join(fields)}"
            raise InputError(f"the system has no field {unknown[0]!r}", where=START, hint=hint)
        columns = []
        for field in fields:
            if field not in start:
                raise InputError(f"the field {field!r} is missing", where=START)
            values = _numbers(start[field], grid.dimensions, f"{START}, {field!r}")
            if values.shape not in ((), shape):
                what = f"the values have the shape {values.shape}, but the grid has {shape}"
                raise InputError(what, where=f"{START}, {field!r}")
            columns.append(torch.from_numpy(np.broadcast_to(values, shape).copy()))
        return grid.ring(torch.stack(columns))

    def _dataset(self, times: Tensor, states: Tensor) -> xr.Dataset:
        system = self.system
        values = system.grid.own(states).numpy()

        def unit(name: str) -> dict[str, str]:
            return {"units": system.units[name]} if name in system.units else {}

        return xr.Dataset(
            {
                field: (
                    ("time", *system.grid.dimensions),
                    np.ascontiguousarray(values[:, i]),
                    unit(field),
                )
                for i, field in enumerate(system.fields)
            },
            {
                "time": ("time", times.numpy(), unit(TIME)),
                **{
                    name: (along, x.numpy(), unit(name))
                    for name, (along, x) in system.grid.labels.items()
                },
            },
            {"title": system.config.title or ""},
        )


def as_times(given: ArrayLike) -> Tensor:
    """Return times as a tensor ``(time,)``, float64.

    Raises:
        InputError: they are not numbers, or they do not increase.
    """
    times = _numbers(given, ("time",), TIMES)
    if times.ndim != 1 or not len(times) or not np.all(np.diff(times) > 0):
        raise InputError("times must be a list of increasing numbers", where=TIMES)
    return torch.from_numpy(times)


def _numbers(given: Any, dims: tuple[str, ...], where: str) -> np.ndarray:
    """Return finite float64 numbers; the dimensions of a DataArray are put in this order."""
    if isinstance(given, xr.DataArray):
        if given.ndim and set(given.dims) != set(dims):
            found = ", ".join(map(str, given.dims))
            what = f"the array has the dimensions ({found}), not ({', '.join(dims)})"
            raise InputError(what, where=where)
        given = given.transpose(*dims) if given.ndim else given
    values = np.asarray(given)
    if values.dtype.kind not in "fiu" or not np.all(np.isfinite(values)):
        raise InputError("finite numbers are expected", where=where)
    return values.astype(np.float64)
