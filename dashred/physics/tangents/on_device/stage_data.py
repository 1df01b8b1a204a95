"""Slopes and sources of the linearised equations at the stages of a trajectory, in torch."""

from __future__ import annotations

from typing import NamedTuple

import torch
from torch import Tensor

from dashred.physics.backends.numpy_backend import Array
from dashred.physics.backends.torch_backend import Program
from dashred.physics.expressions.algebra import Expr
from dashred.physics.grids.grid_value import Value, on_whole_grid
from dashred.physics.grids.transforms import modes_of, points_of
from dashred.physics.system import System
from dashred.physics.tangents.on_device.reference_stages import Stages
from dashred.physics.tangents.semilinear_rhs import Inputs
from dashred.physics.tangents.sources import Sources

ZERO_ROW = -1
"""Index of the row of zeros, for a column without a source in an equation."""


class StageData(NamedTuple):
    """What the columns need at the stages of some steps, in the precision of the columns.

    Attributes:
        slopes: ∂G/∂v, ``(slope, stage, *grid)``.
        rows: source terms of N, then a row of zeros, ``(stage, row, *modes)``.
        shifts: derivatives of the next stage with respect to L, ``(stage, field, *modes)``.
    """

    slopes: Tensor
    rows: Tensor
    shifts: Tensor


class StageEvaluator:
    """Evaluates slopes and sources at the stages of a block of steps.

    Args:
        system: the simulator.
        inputs: inputs of the slopes.
        slopes: ∂G/∂v, the order of ``StageData.slopes``.
        sources: the sources of the columns.
        dtype: precision of the columns, float32 or float64.
    """

    def __init__(
        self,
        system: System,
        inputs: Inputs,
        slopes: list[Expr],
        sources: Sources,
        dtype: torch.dtype,
    ) -> None:
        self.system, self.sources, self.dtype = system, sources, dtype
        self._slopes, self._program = len(slopes), Program([*slopes, *sources.bodies])
        self._inputs = [_InputTable(system, each) for each in (inputs, sources.inputs)]
        complex_dtype, device = dtype.to_complex(), system.device
        self._channels, self._couplings = (
            [
                (row, i, torch.from_numpy(symbol).to(device, complex_dtype))
                for row, i, symbol in each
            ]
            for each in (sources.channels, sources.couplings)
        )
        if sources.forcing_basis is not None:
            self._bumps = torch.from_numpy(sources.bumps).to(device, complex_dtype)

    def __call__(self, times: Array, stages: Stages) -> StageData:
        """Return the data of the stages.

        Args:
            times: of the stages, ``(stage,)``.
            stages: of the trajectory.
        """
        clock = times.reshape(-1, *(1,) * len(self.system.grid.shape))
        values = self.system.coordinates_and_inputs(clock, self.system.device)
        for table in self._inputs:
            values |= table(stages.modes)
        found = [
            self._on_grid(value, len(times))
            for value in self._program(values, self.system.operators)
        ]
        slopes, bodies = found[: self._slopes], found[self._slopes :]
        if self.sources.has_others:
            bodies += self.sources.evaluate_others(stages.modes.transpose(0, 1), clock).unbind()
        rows = self._rows([body.to(self.dtype) for body in bodies], times, stages.modes)
        shifts = stages.shifts.to(rows.dtype)
        return StageData(self._stacked(slopes, len(times)), rows, shifts)

    def _on_grid(self, value: Value, count: int) -> Tensor:
        grid = self.system.grid
        points = on_whole_grid(self.system.operators.on_grid(value), grid)
        return points.to(self.system.device).expand(count, *grid.shape)

    def _stacked(self, fields: list[Tensor], count: int) -> Tensor:
        if fields:
            return torch.stack(fields).to(self.dtype)
        shape = (0, count, *self.system.grid.shape)
        return torch.empty(shape, dtype=self.dtype, device=self.system.device)

    def _rows(self, bodies: list[Tensor], times: Array, modes: Tensor) -> Tensor:
        """Return the rows and the row of zeros, ``(stage, row, *modes)``."""
        modes = modes.to(self.dtype.to_complex())
        rows = modes.new_zeros((len(modes), self.sources.rows + 1, *modes.shape[2:]))
        if bodies:
            hats = modes_of(torch.stack(bodies), self.system.grid.shape)
            for row, body, symbol in self._channels:
                rows[:, row].addcmul_(hats[body], symbol)
        for row, field, symbol in self._couplings:
            rows[:, row].addcmul_(modes[:, field], symbol)
        if self.sources.forcing_basis is None:
            return rows
        courses = torch.from_numpy(self.sources.forcing_basis.hats(times)).to(self._bumps)
        basis_rows = torch.einsum("tk,c...->tck...", courses, self._bumps).flatten(1, 2)
        return torch.cat([rows[:, :-1], basis_rows, rows[:, -1:]], dim=1)


class _InputTable:
    """Inputs ``v = V f`` on the grid, by name."""

    def __init__(self, system: System, inputs: Inputs) -> None:
        self.grid, self.names = system.grid, inputs.names
        self.fields = torch.from_numpy(inputs.fields).to(system.device)
        self.multipliers = torch.from_numpy(inputs.multipliers).to(system.device)

    def __call__(self, modes: Tensor) -> dict[str, Value]:
        """Return the inputs, ``(stage, *grid)`` each, of modes ``(stage, field, *modes)``."""
        if not self.names:
            return {}
        hats = self.multipliers * modes.transpose(0, 1)[self.fields]
        points = points_of(hats, self.grid.shape)
        return dict(zip(self.names, map(Value, points), strict=True))
