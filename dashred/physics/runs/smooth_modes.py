"""Smooth modes of a Gaussian process: waves on rings, eigenvectors of the covariance on nodes."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import partial
from itertools import product

import torch
from torch import Tensor

from dashred.physics.expressions.reflection import side
from dashred.physics.grids.grid import Axis, Grid
from dashred.physics.grids.mesh import Mesh

MIN_VARIANCE = 1e-12


def smooth_modes(grid: Grid | Mesh, length: float) -> list[tuple[float, Callable[[], Tensor]]]:
    """Return variance and mode of each component of a Gaussian process, the strongest first.

    A mode is ``(*grid)``, of mean square 1.

    Args:
        grid: rings or nodes.
        length: correlation length, in the unit of the axes.
    """
    if isinstance(grid, Mesh):
        values, modes = grid.smooth_modes(length)
        kept = [v for v in values.tolist() if v > MIN_VARIANCE]
        return [(v, partial(modes.__getitem__, i)) for i, v in enumerate(kept)]
    return [(power, partial(_wave, grid, k)) for power, k in _powers(grid, length)]


def _powers(grid: Grid, length: float) -> list[tuple[float, list[float]]]:
    """Return the variance and the wave vector of every mode, the strongest first."""
    found = []
    for numbers in product(*map(_wavenumbers, grid.axes)):
        k = [2 * math.pi * m / a.period for m, a in zip(numbers, grid.axes, strict=True)]
        power = math.exp(-sum(component**2 for component in k) * length**2 / 2)
        if power > MIN_VARIANCE:
            found.append((power, k))
    return sorted(found, key=lambda pair: -pair[0])


def _wavenumbers(axis: Axis) -> range:
    """Return the wavenumbers on a ring; with mirror symmetry, only one of each pair."""
    if axis.periodic:
        return range(-(axis.points // 2) + 1, axis.points // 2)
    return range(1 if axis.ends == "fixed" else 0, axis.points)


def _wave(grid: Grid, k: list[float]) -> Tensor:
    """Return a wave of mean square 1, ``(*grid)``, with mirror symmetry along axes with ends.

    Along periodic axes it is ``√2 cos k·x`` for one of each pair ±k and ``√2 sin k·x`` for the
    other. Along other axes it is ``√2 cos kx`` or, between fixed ends, ``√2 sin kx``. It is 1 for
    k = 0.
    """
    wave = torch.ones((), dtype=torch.float64)
    phase = torch.zeros((), dtype=torch.float64)
    leading = 0.0
    for axis, component in zip(grid.axes, k, strict=True):
        x = grid.coordinates[axis.name]
        if axis.periodic:
            leading, phase = leading or component, phase + component * x
        elif axis.ends == "fixed":
            wave = wave * math.sqrt(2) * torch.sin(component * x) * grid.sides[side(axis.name)]
        elif component:
            wave = wave * math.sqrt(2) * torch.cos(component * x)
    if leading:
        wave = wave * math.sqrt(2) * (torch.cos(phase) if leading > 0 else torch.sin(phase))
    return wave.expand(grid.shape)
