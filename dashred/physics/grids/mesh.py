"""Scattered nodes on a line or in the plane, in place of a product of axes."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache, reduce
from hashlib import sha256
from operator import add

import numpy as np
import torch
from scipy.sparse import csr_array
from scipy.spatial import Delaunay, cKDTree
from torch import Tensor

from dashred.physics.grids.grid import Axis, HasAxes
from dashred.physics.grids.nodes_file import read_nodes
from dashred.physics.grids.stencils import Array, local_weights

# Name of the one dimension of a field.
NODE = "node"
# Points of a picture along each axis.
PICTURE = {1: 200, 2: 100}
# Nodes up to which a product with a full matrix is faster than with a sparse one.
MOST_DENSE = 1000
# Share of the extent by which a place may lie outside: rounding of its coordinates.
ROUNDING = 1e-9


@dataclass(frozen=True, eq=False)
class Mesh:
    """Nodes in one or two dimensions; a field is ``(node,)``.

    It has what :class:`dashred.physics.grids.grid.Grid` has, but no wavenumbers. Between the nodes
    a field is that of local stencils (:mod:`dashred.physics.grids.stencils`). The domain is the
    convex hull of the nodes.

    Attributes:
        names: of the coordinates.
        nodes: ``(node, axis)``.
    """

    names: tuple[str, ...]
    nodes: Array

    @cached_property
    def axes(self) -> tuple[Axis, ...]:
        """Extent of each coordinate; the points are those of evenly spread nodes."""
        count, dimension = self.nodes.shape
        points = max(1, round(count ** (1 / dimension)))
        spans = [(min(x), _length(min(x), max(x))) for x in self.nodes.T.tolist()]
        return tuple(
            Axis(name, length, points, "open", begin=begin)
            for name, (begin, length) in zip(self.names, spans, strict=True)
        )

    @cached_property
    def spacing(self) -> float:
        """Median distance of a node from the nearest other one."""
        distances, _ = cKDTree(self.nodes).query(self.nodes, k=[2])
        return float(np.median(distances))

    @property
    def shape(self) -> tuple[int, ...]:
        """Number of nodes."""
        return (len(self.nodes),)

    @property
    def dims(self) -> tuple[int, ...]:
        """Spatial dimension of a tensor, counted from the end."""
        return (-1,)

    @property
    def dimensions(self) -> tuple[str, ...]:
        """Name of the dimension of a field."""
        return (NODE,)

    @cached_property
    def coordinates(self) -> dict[str, Tensor]:
        """Coordinates of every node by name, ``(node,)``, float64."""
        columns = np.ascontiguousarray(self.nodes.T)
        return dict(zip(self.names, torch.from_numpy(columns), strict=True))

    @property
    def places(self) -> dict[str, Tensor]:
        """Coordinates by name, as used in expressions."""
        return self.coordinates

    @property
    def own_coordinates(self) -> dict[str, Tensor]:
        """See :attr:`coordinates`; there are no mirror images."""
        return self.coordinates

    @property
    def sides(self) -> dict[str, Tensor]:
        """Sides of mirrored axes: there are none."""
        return {}

    @cached_property
    def files(self) -> tuple[str, ...]:
        """SHA-256 of the nodes, from whose file a program may read them, too."""
        return (sha256(self.nodes.tobytes()).hexdigest(),)

    @property
    def labels(self) -> dict[str, tuple[str, Tensor]]:
        """Dimension and values of each coordinate in a dataset, ``(node,)``."""
        return {name: (NODE, x) for name, x in self.coordinates.items()}

    def index(self, axis: str) -> int:
        """Return the index of a coordinate by name."""
        return self.names.index(axis)

    def own(self, states: Tensor) -> Tensor:
        """Return the states, which have no mirror images."""
        return states

    def ring(self, states: Tensor) -> Tensor:
        """Return the states, which have no mirror images."""
        return states

    def interpolate(self, states: Tensor, finer: HasAxes) -> Tensor:
        """Return the states: nodes are not refined."""
        return states

    def contains(self, place: Sequence[float]) -> bool:
        """Return whether a place is in the convex hull."""
        if len(self.names) == 1:
            return self.axes[0].wrap(place[0]) == place[0]
        return bool(self._triangles.find_simplex(np.array([place]), tol=ROUNDING)[0] >= 0)

    def wrap(self, place: Sequence[float]) -> tuple[float, ...]:
        """Return the nearest place in the domain."""
        if len(self.names) == 1 or self.contains(place):
            return tuple(axis.wrap(x) for axis, x in zip(self.axes, place, strict=True))
        begin, end = self.nodes[self._triangles.convex_hull].transpose(1, 0, 2)
        along, there = end - begin, np.array(place)
        share = np.sum((there - begin) * along, axis=1) / np.sum(along**2, axis=1)
        nearest = begin + share.clip(0, 1)[:, None] * along
        best = np.linalg.norm(nearest - there, axis=1).argmin()
        return tuple(nearest[best].tolist())

    def values_at(self, places: Array) -> Tensor:
        """Return the weights of the nodes in the value at each place, ``(place, node)``."""
        [weights] = local_weights(self.nodes, places, [(0,) * len(self.names)])
        return torch.from_numpy(weights.toarray())

    @cached_property
    def derivatives(self) -> dict[tuple[int, ...], Tensor]:
        """Weights of derivatives by order, and of the Laplacian, ``(node, node)``.

        The order is that by each coordinate: ``(1, 0)``. The Laplacian is under ``()``. With many
        nodes the matrices are sparse.
        """
        rows = np.eye(len(self.names), dtype=int)
        orders = [*map(tuple, rows.tolist()), *map(tuple, (2 * rows).tolist())]
        weights = local_weights(self.nodes, self.nodes, orders)
        laplacian = reduce(add, weights[len(self.names) :])
        named = zip([*orders, ()], [*weights, laplacian], strict=True)
        return {order: _as_tensor(matrix) for order, matrix in named}

    @cached_property
    def volumes(self) -> Tensor:
        """Weights of the nodes in an integral over the domain, ``(node,)``; linear between them."""
        total = np.zeros(len(self.nodes))
        if len(self.names) == 1:
            order = self.nodes[:, 0].argsort()
            gaps = np.diff(self.nodes[order, 0]) / 2
            np.add.at(total, order[:-1], gaps)
            np.add.at(total, order[1:], gaps)
            return torch.from_numpy(total)
        corners = self._triangles.simplices
        sides = self.nodes[corners[:, 1:]] - self.nodes[corners[:, :1]]
        np.add.at(total, corners, np.abs(np.linalg.det(sides))[:, None] / 6)
        return torch.from_numpy(total)

    def volume(self, field: Tensor) -> float:
        """Return ``Σ f V`` over the nodes, with the volume V of each."""
        return float(field @ self.volumes)

    def picture(self, states: Tensor) -> tuple[dict[str, Tensor], Tensor]:
        """Return even coordinates along each axis, and states ``(…, *points)`` to draw there.

        The states are linear between the nodes, and NaN outside.
        """
        points = PICTURE[len(self.names)]
        lines = [np.linspace(a.begin, a.begin + a.length, points) for a in self.axes]
        flat = states.reshape(-1, len(self.nodes)).numpy()
        if len(lines) == 1:
            order = self.nodes[:, 0].argsort()
            x = self.nodes[order, 0]
            drawn = np.stack([np.interp(lines[0], x, row[order]) for row in flat])
        else:
            places = np.stack(np.meshgrid(*lines, indexing="ij"), axis=-1).reshape(-1, 2)
            drawn = self._linear(places, flat)
        shape = *states.shape[:-1], *(points,) * len(lines)
        coordinates = {name: torch.from_numpy(x) for name, x in zip(self.names, lines, strict=True)}
        return coordinates, torch.from_numpy(drawn).reshape(shape)

    def _linear(self, places: Array, states: Array) -> Array:
        """Return states ``(row, place)``, linear in each triangle."""
        triangles = self._triangles
        found = triangles.find_simplex(places)
        transform = triangles.transform[found]
        two = np.einsum("pij,pj->pi", transform[:, :2], places - transform[:, 2])
        shares = np.concatenate([two, 1 - two.sum(axis=1, keepdims=True)], axis=1)
        values = np.einsum("pi,rpi->rp", shares, states[:, triangles.simplices[found]])
        values[:, found < 0] = np.nan
        return values

    @cached_property
    def _triangles(self) -> Delaunay:
        return Delaunay(self.nodes)


def _length(begin: float, end: float) -> float:
    """Return the distance, rounded so that the end is not beyond ``begin + length``."""
    length = end - begin
    while begin + length < end:
        length = math.nextafter(length, math.inf)
    return length


def _as_tensor(weights: csr_array) -> Tensor:
    if weights.shape[0] <= MOST_DENSE:
        return torch.from_numpy(weights.toarray())
    entries = weights.tocoo()
    where = torch.from_numpy(np.stack([entries.row, entries.col]).astype(np.int64))
    values = torch.from_numpy(entries.data)
    return torch.sparse_coo_tensor(where, values, weights.shape, check_invariants=True).coalesce()


def open_mesh(path: str) -> Mesh:
    """Return the mesh of a file of nodes.

    Raises:
        InputError: see :func:`.nodes_file.read_nodes`.
    """
    names, columns = zip(*read_nodes(path).items(), strict=True)
    return _mesh(names, np.stack(columns, axis=1).tobytes())


@lru_cache
def _mesh(names: tuple[str, ...], nodes: bytes) -> Mesh:
    """Return one mesh for equal nodes: its matrices are computed once."""
    return Mesh(names, np.frombuffer(nodes).reshape(-1, len(names)).copy())
