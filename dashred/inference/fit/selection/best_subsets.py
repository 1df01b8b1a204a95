"""The best sets of up to three candidates on the linearised problem, without solving for all sets.

With ``A = G + P`` and ``b = g`` of :class:`.ProfiledProblem`, a set S lowers F by its gain
``b_Sᵀ A_S⁻¹ b_S``. The gain exceeds a limit t exactly if ``A_S - b_S b_Sᵀ / t`` is not positive
semidefinite (Schur complement). For pairs this is so where a 2 × 2 minor of the matrix
``M = A - b bᵀ / t`` is negative, because M has at most one negative eigenvalue. For three
candidates, one of them, i, is eliminated first:

    M' = A - u uᵀ - a aᵀ / (t - b_i² / A_ii),   u = A_i / √A_ii,   a = b - u b_i / √A_ii.

The limit t is the gain of the worst set that is still kept, which is at least the gain of every
single candidate. Only sets above it are solved for.
"""

from __future__ import annotations

import math

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from dashred.core.numerics.block_tridiagonal import Array
from dashred.inference.fit.selection.subset_search import ProfiledProblem

# Number of elements of the matrices M that are compared at once: they stay in the cache.
ELEMENTS = 50_000
# Up to so many sets are solved for without a limit.
FEW = 500
# The limit is at least the gain of every single candidate. Rounding must not make their difference
# zero; this share of the limit remains.
LEAST_DIFFERENCE = 1e-12


def best_subsets(problem: ProfiledProblem, size: int, most: int) -> Tensor:
    """Return the best sets of a size, the best first, ``(set, size)``.

    The cost of sets of three grows with the cube of the number of candidates.

    Args:
        problem: the linearised problem.
        size: number of candidates in each set, from 1 to 3.
        most: number of sets.
    """
    count = len(problem.target)
    every = torch.arange(count)
    if size == 1 or math.comb(count, size) <= FEW or most > count - size + 1:
        return _Best(problem, torch.combinations(every, size), most).sets
    # The best smaller set gains at least as much as any other one, so its extensions give a limit
    # that no smaller set exceeds.
    smaller = best_subsets(problem, size - 1, 1)[0]
    others = every[~torch.isin(every, smaller), None]
    best = _Best(problem, torch.cat([smaller.expand(len(others), -1), others], dim=1), most)
    gram, target = (tensor.numpy() for tensor in problem.scaled)
    if size == 2:
        best.add(_pairs(gram, target, best.limit))
        return best.sets
    first = 0
    while first < count - 2:
        last = min(count - 2, first + max(1, ELEMENTS // (count - first) ** 2))
        best.add(_triples(gram, target, best.limit, range(first, last)))
        first = last
    return best.sets


class _Best:
    """The best sets so far.

    Attributes:
        sets: the sets, the best first, ``(set, size)``.
        limit: gain of the worst of them.
    """

    def __init__(self, problem: ProfiledProblem, sets: Tensor, most: int) -> None:
        self.problem, self.most = problem, most
        self.sets, self.limit = sets[:0], math.inf
        self.add(sets)

    def add(self, sets: Tensor) -> None:
        """Keep the best of the present sets and of further ones, ``(set, size)``."""
        if not len(sets):
            return
        joined = torch.cat([self.sets, sets.sort(dim=1).values]).unique(dim=0)
        costs, order = self.problem.costs(joined).sort(stable=True)
        self.sets = joined[order[: self.most]]
        # Without any gain (or with columns that are not finite) no limit is exceeded.
        gain = self.problem.constant - float(costs[: self.most][-1])
        self.limit = gain if gain > 0 else math.inf


def _pairs(gram: Array, target: Array, limit: float) -> Tensor:
    """Return the pairs whose gain exceeds a limit, ``(pair, 2)``."""
    _, j, k = _indefinite(gram, target[None, :, None] / np.sqrt(limit))
    return torch.from_numpy(np.stack([j, k], axis=1))


def _triples(gram: Array, target: Array, limit: float, first: range) -> Tensor:
    """Return the sets of three whose gain exceeds a limit, ``(set, 3)``.

    Args:
        gram: A, ``(candidate, candidate)``.
        target: b, ``(candidate,)``.
        limit: t.
        first: the first candidates of the sets.
    """
    rest = slice(first.start + 1, None)
    size = np.sqrt(gram.diagonal()[first])
    eliminated = gram[first, rest] / size[:, None]
    effect = target[first] / size
    left = np.sqrt(np.maximum(limit - effect**2, LEAST_DIFFERENCE * limit))
    remaining = (target[rest] - eliminated * effect[:, None]) / left[:, None]
    i, j, k = _indefinite(gram[rest, rest], np.stack([eliminated, remaining], axis=-1))
    # The matrices of all first candidates have the same rows, also those of earlier candidates.
    sets = np.stack([i, j + 1, k + 1], axis=1)[i < j + 1]
    return torch.from_numpy(sets + first.start)


def _indefinite(
    gram: Array, taken: Array
) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.int64]]:
    """Return the places ``(batch, j, k)``, j < k, where a 2 × 2 minor of ``A - T Tᵀ`` is negative.

    Args:
        gram: A, ``(candidate, candidate)``.
        taken: T, ``(batch, candidate, column)``.
    """
    matrix = gram - taken @ taken.transpose(0, 2, 1)
    diagonal = matrix.diagonal(axis1=1, axis2=2).copy()
    np.square(matrix, out=matrix)
    negative = matrix > diagonal[:, :, None] * diagonal[:, None, :]
    # Most often there is none, which is found faster than places are.
    batch, j, k = np.nonzero(negative if negative.any() else negative[:0])
    upper = j < k
    return batch[upper], j[upper], k[upper]
