"""Spatial operators: spectral on periodic axes, or central finite differences.

Both offer the same four operations on a :class:`Value`, so an equation runs on either.
"""

from __future__ import annotations

from functools import reduce
from typing import Protocol

import torch
from torch import Tensor

from dashred.physics.grid import Grid


class Value:
    """A field as a weighted sum of parts, each known on the grid, by its modes, or both.

    Linear operators and sums take whichever form is there; only products transform, so an
    equation costs the fewest FFTs that its nonlinear terms need.
    """

    __slots__ = ("parts",)

    def __init__(self, points: Tensor | float | None = None, modes: Tensor | None = None) -> None:
        self.parts: list[tuple[float, Part]] = [(1.0, Part(points, modes))]

    def scaled(self, factor: float) -> Value:
        """Return ``factor`` times the field."""
        return _of_parts([(factor * weight, part) for weight, part in self.parts])


class Part:
    """One summand, on the grid or in modes; a transform fills in the other form."""

    __slots__ = ("modes", "points")

    def __init__(self, points: Tensor | float | None, modes: Tensor | None) -> None:
        self.points, self.modes = points, modes


def total(values: list[Value]) -> Value:
    """Return the sum."""
    return _of_parts([weighted for value in values for weighted in value.parts])


def combine(weighted: list[tuple[float, Tensor | float]]) -> Tensor | float:
    """Return ``Σ cᵢ fᵢ`` with no operation for a weight of one."""
    terms = [f if c == 1.0 else c * f for c, f in weighted]
    return reduce(lambda a, b: a + b, terms)


def _of_parts(parts: list[tuple[float, Part]]) -> Value:
    value = Value.__new__(Value)
    value.parts = parts
    return value


class Operators(Protocol):
    """What an equation needs of space."""

    grid: Grid

    def on_grid(self, value: Value) -> Tensor | float:
        """Return the field on the grid."""

    def derivative(self, value: Value, axis: str, order: int) -> Value:
        """Return ``∂ⁿf/∂xⁿ``."""

    def laplacian(self, value: Value) -> Value:
        """Return ``∇²f``."""

    def inverse_laplacian(self, value: Value) -> Value:
        """Return the zero-mean solution g of ``∇²g = f - mean(f)``."""

    def flux(self, value: Value, axis: str, transported: Value) -> Value:
        """Return the conservative derivative ``∂f/∂x`` of a flux of the transported field."""


class NoSpace:
    """The operators of an ODE system: a field is one number."""

    def __init__(self) -> None:
        self.grid = Grid(())

    def on_grid(self, value: Value) -> Tensor | float:
        """Return the number itself."""
        return _points(value)

    def derivative(self, value: Value, axis: str, order: int) -> Value:
        """Refuse: the parser lets no spatial operator through."""
        raise TypeError("an ODE system has no spatial operators")

    def laplacian(self, value: Value) -> Value:
        """Refuse."""
        return self.derivative(value, "", 2)

    def inverse_laplacian(self, value: Value) -> Value:
        """Refuse."""
        return self.derivative(value, "", -2)

    def flux(self, value: Value, axis: str, transported: Value) -> Value:
        """Refuse."""
        return self.derivative(value, axis, 1)


class Spectral:
    """Fourier pseudo-spectral operators, ``∂ⁿ → (ik)ⁿ``, in float64.

    Odd derivatives drop the Nyquist mode, which has no odd part on the grid.
    """

    def __init__(self, grid: Grid) -> None:
        self.grid = grid
        self._multipliers: dict[tuple[str, int, torch.device], Tensor] = {}

    def on_grid(self, value: Value) -> Tensor | float:
        """Return the field on the grid: at most one inverse FFT."""
        known = [(c, p.points) for c, p in value.parts if p.points is not None]
        unknown = [(c, p) for c, p in value.parts if p.points is None]
        if unknown:
            known.append(self._transformed(unknown))
        return combine(known)

    def in_modes(self, value: Value) -> Tensor:
        """Return the Fourier modes ``(…, *modes)``: at most one FFT."""
        known = [(c, p.modes) for c, p in value.parts if p.modes is not None]
        unknown = [(c, p) for c, p in value.parts if p.modes is None]
        if unknown:
            points = on_whole_grid(combine([(c, p.points) for c, p in unknown]), self.grid)
            known.append((1.0, torch.fft.rfftn(points, dim=self.grid.dims)))
        return torch.as_tensor(combine(known))

    def _transformed(self, parts: list[tuple[float, Part]]) -> tuple[float, Tensor]:
        grid = self.grid
        if len(parts) == 1:
            [(weight, part)] = parts
            part.points = torch.fft.irfftn(part.modes, s=grid.shape, dim=grid.dims)
            return weight, part.points
        modes = combine([(c, p.modes) for c, p in parts])
        return 1.0, torch.fft.irfftn(modes, s=grid.shape, dim=grid.dims)

    def derivative(self, value: Value, axis: str, order: int) -> Value:
        """Return ``(ik)ⁿ f̂``."""
        modes = self.in_modes(value)
        return Value(modes=modes * self.multiplier(axis, order, modes.device))

    def laplacian(self, value: Value) -> Value:
        """Return ``-|k|² f̂``."""
        modes = self.in_modes(value)
        return Value(modes=modes * self.multiplier("", 2, modes.device))

    def inverse_laplacian(self, value: Value) -> Value:
        """Return ``-f̂/|k|²`` with zero mean."""
        modes = self.in_modes(value)
        return Value(modes=modes * self.multiplier("", -2, modes.device))

    def flux(self, value: Value, axis: str, transported: Value) -> Value:
        """Return ``∂f/∂x``; a spectral derivative conserves the mean as it is."""
        return self.derivative(value, axis, 1)

    def multiplier(self, axis: str, order: int, device: torch.device) -> Tensor:
        """Return the Fourier symbol of ``∂ⁿ`` along an axis ("" and ±2: ``∇²`` and its inverse)."""
        key = (axis, order, device)
        if key not in self._multipliers:
            # Complex, since modes are: a real factor would be converted at every use.
            self._multipliers[key] = self._symbol(axis, order).to(device, torch.complex128)
        return self._multipliers[key]

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
        points = self.grid.axes[index].points
        if points % 2 == 0:
            nyquist = torch.arange(k.numel()).reshape(k.shape) == points // 2
            k = torch.where(nyquist, 0.0, k)
        return 1j * (-1.0) ** (order // 2) * k**order


def on_whole_grid(points: Tensor | float, grid: Grid) -> Tensor:
    """Expand a number, a coordinate or a field to ``(…, *grid)``."""
    field = torch.as_tensor(points, dtype=torch.float64)
    rank = len(grid.shape)
    if field.shape[-rank:] == grid.shape:
        return field
    batch = field.shape[:-rank] if field.dim() > rank else ()
    return field.expand(*batch, *grid.shape)


def _points(value: Value) -> Tensor | float:
    return combine([(weight, part.points) for weight, part in value.parts])


class FiniteDifferences:
    """Central differences of second order, and a first-order upwind flux, on periodic axes."""

    def __init__(self, grid: Grid) -> None:
        self.grid = grid

    def on_grid(self, value: Value) -> Tensor | float:
        """Return the field on the grid."""
        return _points(value)

    def derivative(self, value: Value, axis: str, order: int) -> Value:
        """Return ``(f₊ - f₋)/2h`` once for odd orders, ``(f₊ - 2f + f₋)/h²`` for each pair."""
        points, dim, h = self._along(value, axis)
        for _ in range(order // 2):
            points = (points.roll(-1, dim) - 2 * points + points.roll(1, dim)) / h**2
        if order % 2:
            points = (points.roll(-1, dim) - points.roll(1, dim)) / (2 * h)
        return Value(points)

    def laplacian(self, value: Value) -> Value:
        """Return the sum of second differences over the axes."""
        return total([self.derivative(value, axis.name, 2) for axis in self.grid.axes])

    def inverse_laplacian(self, value: Value) -> Value:
        """Return the spectral inverse: a global operator has no local stencil."""
        return Value(Spectral(self.grid).on_grid(Spectral(self.grid).inverse_laplacian(value)))

    def flux(self, value: Value, axis: str, transported: Value) -> Value:
        """Return ``(F₊ - F₋)/h`` with the Murman–Roe upwind flux at the cell faces.

        ``F = (f_j + f_{j+1})/2 - sign(a) (f_{j+1} - f_j)/2`` with the wave speed
        ``a = (f_{j+1} - f_j)/(u_{j+1} - u_j)`` of the transported field u
        (LeVeque, Finite Volume Methods for Hyperbolic Problems, §12.2).
        """
        f, dim, h = self._along(value, axis)
        u, _, _ = self._along(transported, axis)
        jump = f.roll(-1, dim) - f
        upwind = torch.sign(jump * (u.roll(-1, dim) - u))
        face = (f + f.roll(-1, dim) - upwind * jump) / 2
        return Value((face - face.roll(1, dim)) / h)

    def _along(self, value: Value, axis: str) -> tuple[Tensor, int, float]:
        index = self.grid.index(axis)
        points = on_whole_grid(self.on_grid(value), self.grid)
        dim = self.grid.dims[index]
        return points, dim, self.grid.axes[index].spacing
