"""Fourier pseudo-spectral operators on periodic axes."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import torch
from torch import Tensor

from dashred.physics.grids.grid import Grid
from dashred.physics.grids.grid_value import Part, Value, combine, of_parts, on_whole_grid
from dashred.physics.grids.transforms import modes_of, points_of

Weighted = tuple[float, Tensor]


class Plan(NamedTuple):
    """The modes of one field as a weighted sum.

    Attributes:
        known: modes that are known.
        transformed: ``(weight, symbol, i)`` for ``weight·symbol·FFT(source i)``; a symbol of None
            is 1.
    """

    known: list[Weighted]
    transformed: list[tuple[float, Tensor | None, int]]


class Spectral:
    """Spectral derivatives ``∂ⁿ → (ik)ⁿ``, in float64.

    Odd derivatives set the Nyquist mode to zero, because its sine vanishes on the grid.
    """

    def __init__(self, grid: Grid) -> None:
        self.grid = grid
        self._multipliers: dict[tuple[str, int, torch.device], Tensor] = {}

    def on_grid(self, value: Value) -> Tensor | float:
        """Return the field on the grid, with at most one inverse FFT."""
        known = [(c, p.points) for c, p in value.parts if p.points is not None]
        unknown = [(c, p) for c, p in value.parts if p.points is None]
        if unknown:
            known.append(self._back_transformed(unknown))
        return combine(known)

    def in_modes(self, value: Value) -> Tensor:
        """Return the Fourier modes ``(…, *modes)``."""
        known, rest = self._known_modes(value)
        if len(rest) == 1:
            [(weight, part)] = rest
            part.modes = self._forward(self._whole(rest, weighted=False))
            known.append((weight, part.modes))
        elif rest:
            known.append((1.0, self._forward(self._whole(rest))))
        return torch.as_tensor(combine(known))

    def stacked_modes(self, values: Sequence[Value], like: Tensor) -> Tensor:
        """Return the modes of several fields, ``(batch, field, *modes)``, with a single FFT.

        Args:
            values: the fields, with or without a batch dimension.
            like: modes ``(batch, *modes)`` with the shape and device of one field.
        """
        sources: list[Tensor] = []
        plans = [self._plan(value, sources) for value in values]
        hats: tuple[Tensor, ...] = ()
        if sources:
            shape = (*like.shape[: -len(self.grid.shape)], *self.grid.shape)
            whole = [source.to(like.device).expand(shape) for source in sources]
            hats = self._forward(torch.stack(whole, dim=1)).unbind(1)
        return torch.stack([_assembled(plan, hats).expand(like.shape) for plan in plans], dim=1)

    def derivative(self, value: Value, axis: str, order: int) -> Value:
        """Return ``(ik)ⁿ f̂``."""
        return self._multiplied(value, axis, order)

    def laplacian(self, value: Value) -> Value:
        """Return ``-|k|² f̂``."""
        return self._multiplied(value, "", 2)

    def inverse_laplacian(self, value: Value) -> Value:
        """Return ``-f̂/|k|²`` with zero mean."""
        return self._multiplied(value, "", -2)

    def flux(self, value: Value, axis: str, transported: Value) -> Value:
        """Return ``∂f/∂x``; a spectral derivative conserves the mean."""
        return self.derivative(value, axis, 1)

    def multiplier(self, axis: str, order: int, device: torch.device) -> Tensor:
        """Return the symbol of ``∂ⁿ`` along an axis; "" and ±2 for ``∇²`` and its inverse."""
        key = (axis, order, device)
        if key not in self._multipliers:
            # Complex like the modes: a real factor would be converted at every use.
            self._multipliers[key] = self._symbol(axis, order).to(device, torch.complex128)
        return self._multipliers[key]

    def _multiplied(self, value: Value, axis: str, order: int) -> Value:
        known, rest = self._known_modes(value)
        parts: list[tuple[float, Part]] = []
        if known:
            modes = torch.as_tensor(combine(known))
            parts.append((1.0, Part(modes=modes * self.multiplier(axis, order, modes.device))))
        if rest:
            # Deferred, so that one FFT can transform several fields.
            weight = rest[0][0] if len(rest) == 1 else 1.0
            points = self._whole(rest, weighted=len(rest) > 1)
            symbol = self.multiplier(axis, order, points.device)
            parts.append((weight, Part(source=(points, symbol))))
        return of_parts(parts)

    def _known_modes(self, value: Value) -> tuple[list[Weighted], list[tuple[float, Part]]]:
        known: list[Weighted] = []
        rest: list[tuple[float, Part]] = []
        for weight, part in value.parts:
            if part.modes is None and part.source is not None:
                points, symbol = part.source
                part.modes = symbol * self._forward(points)
            if part.modes is None:
                rest.append((weight, part))
            else:
                known.append((weight, part.modes))
        return known, rest

    def _plan(self, value: Value, sources: list[Tensor]) -> Plan:
        plan = Plan([], [])
        rest: list[tuple[float, Part]] = []
        for weight, part in value.parts:
            if part.modes is not None:
                plan.known.append((weight, part.modes))
            elif part.source is not None:
                points, symbol = part.source
                plan.transformed.append((weight, symbol, len(sources)))
                sources.append(points)
            else:
                rest.append((weight, part))
        if rest:
            plan.transformed.append((1.0, None, len(sources)))
            sources.append(self._whole(rest))
        return plan

    def _whole(self, rest: list[tuple[float, Part]], weighted: bool = True) -> Tensor:
        points = [(c if weighted else 1.0, p.points) for c, p in rest if p.points is not None]
        return on_whole_grid(combine(points), self.grid)

    def _forward(self, points: Tensor) -> Tensor:
        return modes_of(points, self.grid.shape)

    def _back_transformed(self, parts: list[tuple[float, Part]]) -> tuple[float, Tensor | float]:
        grid = self.grid
        modes, _ = self._known_modes(of_parts(parts))
        if len(modes) == 1:
            [(weight, single)] = modes
            parts[0][1].points = points_of(single, grid.shape)
            return weight, parts[0][1].points
        summed = torch.as_tensor(combine(modes))
        return 1.0, points_of(summed, grid.shape)

    def _symbol(self, axis: str, order: int) -> Tensor:
        if not axis:
            zero = torch.zeros((), dtype=torch.float64)
            squared = sum((k**2 for k in self.grid.wavenumbers), zero)
            inverse = torch.where(squared > 0, -1 / squared.clamp(min=1e-300), 0.0)
            return -squared if order == 2 else inverse
        index = self.grid.index(axis)
        k = self.grid.wavenumbers[index]
        if order % 2 == 0:
            return (-1.0) ** (order // 2) * k**order
        points = self.grid.axes[index].ring_points
        if points % 2 == 0:
            nyquist = torch.arange(k.numel()).reshape(k.shape) == points // 2
            k = torch.where(nyquist, 0.0, k)
        return 1j * (-1.0) ** (order // 2) * k**order


def _assembled(plan: Plan, hats: Sequence[Tensor]) -> Tensor:
    known = [(weight, hats[i]) for weight, symbol, i in plan.transformed if symbol is None]
    summed = [*known, *plan.known]
    found = torch.as_tensor(combine(summed)) if summed else None
    for weight, symbol, i in plan.transformed:
        if symbol is None:
            continue
        if found is None:
            found = weight * (symbol * hats[i])
        else:
            found = torch.addcmul(found, symbol, hats[i], value=weight)
    assert found is not None
    return found
