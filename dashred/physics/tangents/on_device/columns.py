"""Integrate the columns of a sensitivity along the stages of a trajectory, in torch."""

from __future__ import annotations

import numpy as np
import torch
from torch import Tensor

from dashred.physics.grids.transforms import modes_of, points_of
from dashred.physics.solvers.etdrk4 import Coefficients
from dashred.physics.system import System
from dashred.physics.tangents.on_device.stage_data import ZERO_ROW, StageData
from dashred.physics.tangents.semilinear_rhs import Modes, SemilinearTendency
from dashred.physics.tangents.sources import Sources
from dashred.physics.tangents.spectral_columns.equations import renumber, select_columns, slopes_of


class Columns:
    """Some columns, which ``δu' = Lδu + N'(u)δu + θ`` advances with ETDRK4.

    The counterpart of :class:`.equations.ColumnEquations` for any device.

    Args:
        system: the simulator, for the grid and the device.
        tendency: L and N of the equations.
        sources: the sources θ.
        chunk: indices of these columns.
        dtype: precision, float32 or float64.
    """

    def __init__(
        self,
        system: System,
        tendency: SemilinearTendency,
        sources: Sources,
        chunk: range,
        dtype: torch.dtype,
    ) -> None:
        self.grid, self.device, self.dtype = system.grid, system.device, dtype.to_complex()
        places = slopes_of(tendency)
        # Inputs and channels without a slope need no FFT.
        channels, self._writes = renumber([channel for channel, _, _ in places])
        inputs, self._reads = renumber([place for _, place, _ in places])
        self._fields = self._to_device(tendency.inputs.fields[inputs])
        self._multipliers = self._symbols(tendency.inputs.multipliers[inputs])
        self._channel_symbols = self._symbols(tendency.channel_symbols[channels])
        self._channel_equations = [tendency.channel_equations[channel] for channel in channels]
        self._couplings = [
            (equation, field, self._symbols(symbol))
            for equation, field, symbol in tendency.couplings
        ]
        self._mask = self._to_device(tendency.mask).to(dtype)
        # The columns of directions come first; they have no sources.
        drives, shifts = (select_columns(each, chunk) for each in (sources.drives, sources.shifts))
        self._first = min([len(chunk), *drives[:, 1], *shifts[:, 1]])
        shape = len(tendency.linear), len(chunk) - self._first
        rows = np.full(shape, ZERO_ROW)
        rows[drives[:, 0], drives[:, 1] - self._first] = drives[:, 2]
        symbols = np.zeros((*shape, *tendency.mask.shape), dtype=np.complex128)
        symbols[shifts[:, 0], shifts[:, 1] - self._first] = sources.symbols[shifts[:, 2]]
        self._rows = self._to_device(rows)
        self._shift_symbols = self._symbols(symbols) if len(shifts) else None

    def in_modes(self, points: Tensor) -> Tensor:
        """Return the modes ``(field, column, *modes)`` of columns ``(field, column, *grid)``."""
        return modes_of(points, self.grid.shape) * self._mask

    def on_grid(self, modes: Tensor) -> Tensor:
        """Return the columns on the grid."""
        return points_of(modes, self.grid.shape)

    def step(self, u: Tensor, step: Coefficients, data: StageData, at: int) -> Tensor:
        """Return the columns after a step.

        Args:
            u: modes of the columns, ``(field, column, *modes)``.
            step: coefficients, ``(field, 1, *modes)`` each.
            data: of the stages.
            at: index of the first stage of the step.
        """
        n = self._tendency(u, data, at)
        linear, driven = step.half * u, step.q * n
        a = linear + driven
        rest, end = step.half * a - driven, step.full * u + step.first * n
        n = self._tendency(self._shift(a, data, at), data, at + 1)
        end.addcmul_(step.middle, n)
        b = linear.addcmul_(step.q, n)
        n = self._tendency(self._shift(b, data, at + 1), data, at + 2)
        end.addcmul_(step.middle, n)
        c = rest.addcmul_(step.q, n, value=2)
        n = self._tendency(self._shift(c, data, at + 2), data, at + 3)
        return self._shift(end.addcmul_(step.last, n), data, at + 3)

    def _shift(self, modes: Tensor, data: StageData, at: int) -> Tensor:
        """Add what the sources change in L."""
        if self._shift_symbols is not None:
            modes[:, self._first :].addcmul_(self._shift_symbols, data.shifts[at, :, None])
        return modes

    def _tendency(self, modes: Tensor, data: StageData, at: int) -> Tensor:
        """Return ``N'δu + θ`` in modes."""
        n = torch.zeros_like(modes)
        n[:, self._first :] = data.rows[at, self._rows]
        if self._channel_equations:
            hats = modes_of(self._channels(modes, data.slopes[:, at]), self.grid.shape)
            for equation, symbol, hat in zip(
                self._channel_equations, self._channel_symbols, hats, strict=True
            ):
                n[equation].addcmul_(symbol, hat)
        for equation, field, symbol in self._couplings:
            n[equation].addcmul_(symbol, modes[field])
        return n

    def _channels(self, modes: Tensor, slopes: Tensor) -> Tensor:
        """Return ``δG_m = Σ_i ∂G_m/∂v_i δv_i``, ``(channel, column, *grid)``."""
        inputs = self.on_grid(modes[self._fields] * self._multipliers)
        channels = inputs.new_zeros((len(self._channel_equations), *inputs.shape[1:]))
        for channel, place, slope in zip(self._writes, self._reads, slopes, strict=True):
            channels[channel].addcmul_(slope, inputs[place])
        return channels

    def _to_device(self, array: Modes) -> Tensor:
        return torch.from_numpy(np.ascontiguousarray(array)).to(self.device)

    def _symbols(self, symbols: Modes) -> Tensor:
        return self._to_device(symbols).to(self.dtype)
