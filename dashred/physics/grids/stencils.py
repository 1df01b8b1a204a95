"""Weights of derivatives and values on scattered nodes: polyharmonic splines with polynomials.

About a place the values f of the k nearest nodes z_j are interpolated by::

    s(x) = Σ_j a_j |x - z_j|³ + Σ_m b_m p_m(x)        Σ_j a_j p_m(z_j) = 0

with all polynomials p of degree 3 (Flyer, Fornberg, Bayona & Barnett, J. Comput. Phys. 321, 2016).
A derivative of s is a weighted sum of the f. Its error is O(h⁴⁻ⁿ) for order n and distance h.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from itertools import product

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array
from scipy.spatial import cKDTree

Array = NDArray[np.float64]
Indices = NDArray[np.intp]

DEGREE = 3
# Nodes of a stencil for each polynomial, the customary number.
NODES_PER_POLYNOMIAL = 2
# Largest condition of the polynomials on a stencil: nodes on a curve do not determine them.
MOST_CONDITION = 1e6
# Places whose systems of equations are solved at once.
AT_ONCE = 1000


class DegenerateNodesError(Exception):
    """The nodes around a place lie on a curve of low degree.

    Attributes:
        place: the place.
    """

    def __init__(self, place: Array) -> None:
        super().__init__(place)
        self.place = place


def stencil_size(dimension: int) -> int:
    """Return the number of nodes of a stencil, which is the fewest that a mesh may have."""
    return NODES_PER_POLYNOMIAL * len(_exponents(dimension))


def local_weights(
    nodes: Array, places: Array, derivatives: Sequence[tuple[int, ...]]
) -> list[csr_array]:
    """Return the weights of each derivative at some places, ``(place, node)`` each.

    Args:
        nodes: ``(node, axis)``.
        places: ``(place, axis)``.
        derivatives: order by axis, at most 2 altogether: ``(0, 1)`` is ``∂/∂y``; ``(0, 0)`` is
            the value.

    Raises:
        DegenerateNodesError: the nodes around a place lie on a curve of low degree.
    """
    parts = list(
        _entries(nodes, places, np.arange(len(places)), derivatives, stencil_size(nodes.shape[1]))
    )
    rows, columns = (np.concatenate([part[i].ravel() for part in parts]) for i in (0, 1))
    weights = np.concatenate([part[2].reshape(-1, len(derivatives)) for part in parts])
    shape = len(places), len(nodes)
    return [csr_array((values, (rows, columns)), shape=shape) for values in weights.T]


def _entries(
    nodes: Array,
    places: Array,
    chosen: Indices,
    derivatives: Sequence[tuple[int, ...]],
    size: int,
) -> Iterator[tuple[Indices, Indices, Array]]:
    """Yield place, node, both ``(place, node)``, and weights ``(place, node, derivative)``.

    A stencil whose nodes lie on a curve gets twice as many.
    """
    tree = cKDTree(nodes)
    for part in np.array_split(chosen, -(-len(chosen) // AT_ONCE)):
        near = np.asarray(tree.query(places[part], k=size)[1])
        offsets = nodes[near] - places[part][:, None]
        scale = np.linalg.norm(offsets, axis=2).max(axis=1)
        offsets /= scale[:, None, None]
        good = np.asarray(np.linalg.cond(_monomials(offsets))) < MOST_CONDITION
        powers = np.array([sum(alpha) for alpha in derivatives])
        weights = _solve(offsets[good], derivatives) / scale[good, None, None] ** powers
        yield np.repeat(part[good, None], size, axis=1), near[good], weights
        if good.all():
            continue
        if size == len(nodes):
            raise DegenerateNodesError(places[part[~good][0]])
        yield from _entries(nodes, places, part[~good], derivatives, min(2 * size, len(nodes)))


def _solve(offsets: Array, derivatives: Sequence[tuple[int, ...]]) -> Array:
    """Return the weights ``(place, node, derivative)`` at 0 of nodes ``(place, node, axis)``."""
    count, size, dimension = offsets.shape
    exponents = _exponents(dimension)
    whole = size + len(exponents)
    matrix = np.zeros((count, whole, whole))
    apart = offsets[:, :, None] - offsets[:, None, :]
    matrix[:, :size, :size] = np.linalg.norm(apart, axis=3) ** 3
    matrix[:, :size, size:] = monomials = _monomials(offsets)
    matrix[:, size:, :size] = monomials.transpose(0, 2, 1)
    right = np.zeros((count, whole, len(derivatives)))
    for index, alpha in enumerate(derivatives):
        right[:, :size, index] = _spline_derivative(offsets, alpha)
        # A derivative of a monomial is not zero at 0 only if it is a constant.
        right[:, size + exponents.index(alpha), index] = math.prod(map(math.factorial, alpha))
    return np.linalg.solve(matrix, right)[:, :size]


def _spline_derivative(offsets: Array, alpha: tuple[int, ...]) -> Array:
    """Return ``∂^α |x - z|³`` at x = 0, ``(place, node)``."""
    distance = np.linalg.norm(offsets, axis=2)
    axes = [axis for axis, order in enumerate(alpha) for _ in range(order)]
    if not axes:
        return distance**3
    if len(axes) == 1:
        return -3 * distance * offsets[:, :, axes[0]]
    first, second = axes
    mixed = 3 * offsets[:, :, first] * offsets[:, :, second]
    found = np.divide(mixed, distance, out=np.zeros_like(mixed), where=distance > 0)
    return found + 3 * distance if first == second else found


def _monomials(offsets: Array) -> Array:
    """Return the monomials at the nodes, ``(place, node, monomial)``."""
    exponents = np.array(_exponents(offsets.shape[2]))
    return np.prod(offsets[:, :, None, :] ** exponents, axis=3)


def _exponents(dimension: int) -> list[tuple[int, ...]]:
    """Return the exponents of all monomials of the degree."""
    every = product(range(DEGREE + 1), repeat=dimension)
    return sorted(powers for powers in every if sum(powers) <= DEGREE)
