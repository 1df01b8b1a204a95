"""Sampled states at which expressions are evaluated: states of a simulation, and random ones."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from jaxtyping import Float
from torch import Tensor

from dashred.physics.backends.torch_backend import Program
from dashred.physics.expressions.algebra import Expr, Number, substitute
from dashred.physics.expressions.reflection import side
from dashred.physics.grids.grid import Grid
from dashred.physics.system import System

# Number of random states for each wavelength.
DRAWS_PER_WAVELENGTH = 8
# Share of the highest wavenumber up to which products of waves are resolved.
RESOLVED = 1 / 3
NEGLIGIBLE = 1e-9


@dataclass(frozen=True)
class SampledStates:
    """States, each at its own time.

    Attributes:
        states: ``(state, field, *grid)``.
        times: ``(state,)``.
    """

    states: Float[Tensor, "state field ..."]
    times: Float[Tensor, " state"]

    def with_waves(self, system: System) -> SampledStates:
        """Return these states and random states of the same rms.

        The random states have single wavelengths, or all of them. A trajectory may contain only
        few wavelengths, so that it cannot test an expression at the others.
        """
        single = random_waves(system.product_grid, len(system.fields))
        waves = torch.cat([single.flatten(0, 1), single.sum(dim=0) / len(single) ** 0.5])
        space = system.grid.dims
        size = self.states.square().mean(dim=(0, *space), keepdim=True).sqrt()
        times = self.times[torch.arange(len(waves)) % len(self.times)]
        return SampledStates(torch.cat([self.states, waves * size]), torch.cat([self.times, times]))


def random_waves(grid: Grid, fields: int) -> Float[Tensor, "wavelength draw field ..."]:
    """Return random states with one wavelength each and rms 1, that satisfy the end conditions.

    For an ODE system, the fields are independent random numbers, with a single "wavelength".
    """
    generator = torch.Generator().manual_seed(0)
    shape = (DRAWS_PER_WAVELENGTH, fields, *grid.shape)
    noise = torch.randn(shape, generator=generator, dtype=torch.float64)
    if not grid.axes:
        return noise[None]
    modes = torch.fft.rfftn(_symmetrised(grid, noise), dim=grid.dims)
    number = sum(
        (k * axis.period / (2 * torch.pi)) ** 2
        for k, axis in zip(grid.wavenumbers, grid.axes, strict=True)
    )
    shell = torch.as_tensor(number).sqrt().round()
    most = int(RESOLVED * min(grid.shape) / 2)
    waves = torch.stack(
        [
            torch.fft.irfftn(modes * (shell == index), s=grid.shape, dim=grid.dims)
            for index in range(most + 1)
        ]
    )
    rms = waves.square().mean(dim=(1, *grid.dims), keepdim=True).sqrt()
    # Wavelengths that the end conditions exclude have only rounding errors left.
    there = (rms > NEGLIGIBLE * rms.amax()).flatten(1).all(dim=1)
    return waves[there] / rms[there]


def _symmetrised(grid: Grid, field: Tensor) -> Tensor:
    """Return the part of a field that has the mirror symmetry at the ends of every axis."""
    for dim, axis in zip(grid.dims, grid.axes, strict=True):
        if axis.mirrored:
            image = field.flip(dim).roll(1, dim)
            field = field + (image if axis.ends == "insulated" else -image)
    return field


def evaluate(system: System, expr: Expr, at: SampledStates) -> Float[Tensor, "state ..."]:
    """Return an expression at the states, ``(state, *grid)``; valid on the axes themselves.

    Args:
        system: with the names of the expression.
        expr: resolved expression; the side of every mirror image is set to 1.
        at: the states.
    """
    shape = (len(at.states), *system.grid.shape)
    clock = at.times.reshape(-1, *(1,) * len(system.grid.shape)).numpy()
    [value] = Program([without_sides(expr, system)])(
        system.values(at.states, clock), system.operators
    )
    return torch.as_tensor(system.operators.on_grid(value), dtype=torch.float64).expand(shape)


def without_sides(expr: Expr, system: System) -> Expr:
    """Return an expression as on the axes themselves, where every side is 1."""
    return substitute(expr, {side(axis.name): Number(1.0) for axis in system.axes})
