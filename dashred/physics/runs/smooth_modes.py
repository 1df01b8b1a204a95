"""Smooth modes of a Gaussian process: waves on rings, eigenvectors of the covariance on nodes."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import lru_cache, partial
from itertools import product

import numpy as np
import torch
from scipy.spatial.distance import cdist
from torch import Tensor

from dashred.physics.expressions.reflection import side
from dashred.physics.grids.grid import Axis, Grid
from dashred.physics.grids.mesh import Mesh
from dashred.physics.grids.stencils import Array

MIN_VARIANCE = 1e-12
# Nodes of which the covariance of a Gaussian process is decomposed at most, and the smallest
# variance of a mode, as a share of the largest: smaller ones are rounding errors.
MOST_CORRELATED, SMALLEST_VARIANCE = 1000, 1e-10


def smooth_modes(grid: Grid | Mesh, length: float) -> list[tuple[float, Callable[[], Tensor]]]:
    """Return variance and mode of each component of a Gaussian process, the strongest first.

    A mode is ``(*grid)``, of mean square 1.

    Args:
        grid: rings or nodes.
        length: correlation length, in the unit of the axes.
    """
    if isinstance(grid, Mesh):
        values, modes = modes_of_nodes(grid, length)
        kept = [v for v in values.tolist() if v > MIN_VARIANCE]
        return [(v, partial(modes.__getitem__, i)) for i, v in enumerate(kept)]
    return [(power, partial(_wave, grid, k)) for power, k in _powers(grid, length)]


@lru_cache
def modes_of_nodes(mesh: Mesh, length: float) -> tuple[Tensor, Tensor]:
    """Return variances ``(mode,)`` and modes ``(mode, node)`` of mean square 1, largest first.

    They belong to the covariance ``exp(-r²/2ℓ²)``. With many nodes n the process is conditioned on
    a sample s of them, and has the covariance ``C_ns C_ss⁻¹ C_sn`` (Williams & Seeger, NIPS 13,
    2000).

    Args:
        mesh: the nodes.
        length: ℓ, in the unit of the coordinates.
    """
    nodes = mesh.nodes
    sample = nodes[np.random.default_rng(0).permutation(len(nodes))[:MOST_CORRELATED]]
    values, vectors = np.linalg.eigh(_covariance(sample, sample, length))
    kept = values > SMALLEST_VARIANCE * values[-1]
    columns = _covariance(nodes, sample, length) @ (vectors[:, kept] / values[kept] ** 0.5)
    variances = np.mean(columns**2, axis=0)
    order = variances.argsort()[::-1]
    modes = (columns / variances**0.5).T[order]
    return torch.from_numpy(variances[order]), torch.from_numpy(np.ascontiguousarray(modes))


def _covariance(some: Array, others: Array, length: float) -> Array:
    return np.exp(-cdist(some, others, "sqeuclidean") / (2 * length**2))


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
