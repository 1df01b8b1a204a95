"""States at which expressions are looked at, each at its own time: visited ones, and others."""

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

# States that are drawn of each wavelength.
DRAWS = 8
# Of the highest wavenumber: products of longer waves are still resolved.
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
        """Return these states and random ones, as large: of single wavelengths, and of them all.

        A trajectory may keep to few waves, and of those that it does not have says nothing.
        """
        single = waves_of(system.grid, len(system.fields))
        waves = torch.cat([single.flatten(0, 1), single.sum(dim=0) / len(single) ** 0.5])
        space = system.grid.dims
        size = self.states.square().mean(dim=(0, *space), keepdim=True).sqrt()
        times = self.times[torch.arange(len(waves)) % len(self.times)]
        return SampledStates(torch.cat([self.states, waves * size]), torch.cat([self.times, times]))


def waves_of(grid: Grid, fields: int) -> Float[Tensor, "wavelength draw field ..."]:
    """Return random states of one wavelength each and rms 1, as they may be at the ends.

    Of an ODE system there is one "wavelength": its fields are independent random numbers.
    """
    generator = torch.Generator().manual_seed(0)
    shape = (DRAWS, fields, *grid.shape)
    noise = torch.randn(shape, generator=generator, dtype=torch.float64)
    if not grid.axes:
        return noise[None]
    modes = torch.fft.rfftn(_mirrored(grid, noise), dim=grid.dims)
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
    # What the ends leave nothing of is rounding.
    there = (rms > NEGLIGIBLE * rms.amax()).flatten(1).all(dim=1)
    return waves[there] / rms[there]


def _mirrored(grid: Grid, field: Tensor) -> Tensor:
    """Return a field's part that is the mirror image of itself beyond the ends of every axis."""
    for dim, axis in zip(grid.dims, grid.axes, strict=True):
        if not axis.periodic:
            image = field.flip(dim).roll(1, dim)
            field = field + (image if axis.ends == "insulated" else -image)
    return field


def evaluate(system: System, expr: Expr, at: SampledStates) -> Float[Tensor, "state ..."]:
    """Return an expression at states, ``(state, *grid)``: right on the axes proper.

    Args:
        system: whose names it reads.
        expr: resolved; sides of mirror images are 1, as on the axes proper.
        at: the states.
    """
    shape = (len(at.states), *system.grid.shape)
    clock = at.times.reshape(-1, *(1,) * len(system.grid.shape)).numpy()
    [value] = Program([bare(expr, system)])(system.values(at.states, clock), system.operators)
    return torch.as_tensor(system.operators.on_grid(value), dtype=torch.float64).expand(shape)


def bare(expr: Expr, system: System) -> Expr:
    """Return an expression as it is on the axes proper, where every side is 1."""
    return substitute(expr, {side(axis.name): Number(1.0) for axis in system.axes})
