"""Search for sets of candidates on the linearised problem, by linear algebra alone.

The start is eliminated first: a column counts only for the part that no change of the start can
reproduce.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import chain, combinations

import numpy as np
import torch
from jaxtyping import Float
from scipy.linalg import qr
from torch import Tensor

from dashred.core.numerics.block_tridiagonal import Array
from dashred.inference.fit.least_squares import LeastSquaresProblem, NormalEquations
from dashred.inference.fit.normal_equations import solve

CHUNK = 20000
# Added to the diagonal of a matrix whose diagonal is 1.
RIDGE = 1e-10
# The inverse is updated when a candidate is dropped. Where an element of its diagonal has become
# smaller by this factor, the candidate of that element was nearly collinear with dropped ones, and
# too many digits are lost: the inverse is computed again.
LARGEST_DECREASE = 1e4
# The effects of candidates are compared up to this factor times the horizon.
LOOKAHEAD = 3


@dataclass(frozen=True)
class ProfiledProblem:
    """The profiled problem ``F(ξ) = c - 2 gᵀξ + ξᵀ(G + P)ξ``, minimised over the start.

    Attributes:
        gram: G, the Schur complement, without the prior of ξ, ``(candidate, candidate)``.
        target: g, ``(candidate,)``.
        constant: c, the cost of the empty set.
        precision: diagonal of P, the precision of the prior of ξ, ``(candidate,)``.
    """

    gram: Float[Tensor, "candidate candidate"]
    target: Float[Tensor, " candidate"]
    constant: float
    precision: Float[Tensor, " candidate"]

    @classmethod
    def from_normal_equations(cls, normal: NormalEquations, modes: int) -> ProfiledProblem:
        """Eliminate the first unknowns under their priors: the start, and a law if there is one.

        Args:
            normal: normal equations at a point.
            modes: number of unknowns that are eliminated.
        """
        target = normal.target
        start = normal.jacobian[:, :modes] / normal.precision[:modes].sqrt()
        error = normal.jacobian[:, modes:]
        eye = torch.eye(modes, dtype=start.dtype)
        # ‖b - J_z z‖² + ‖z‖² as one least-squares problem; its residual space remains.
        q, _ = torch.linalg.qr(torch.cat([start, eye]))
        stacked = torch.cat([error, torch.zeros(modes, error.shape[1], dtype=error.dtype)])
        right = torch.cat([target, torch.zeros(modes, dtype=target.dtype)])
        columns = stacked - q @ (q.T @ stacked)
        residual = right - q @ (q.T @ right)
        return cls(
            columns.T @ columns,
            columns.T @ residual,
            float(residual.square().sum()),
            normal.precision[modes:],
        )

    @classmethod
    def from_change(
        cls, changes: tuple[Array, Array, float], at: Array, precision: Array
    ) -> ProfiledProblem:
        """Return the problem in the coefficients, given the one in their change from a point.

        Args:
            changes: H, h and d of ``F(ξ₀ + δ) = d - 2 hᵀδ + δᵀ H δ``, where H includes the prior.
            at: ξ₀, ``(candidate,)``.
            precision: of the prior, ``(candidate,)``.
        """
        gram, target, cost = changes
        constant = cost + float(2 * target @ at + at @ gram @ at)
        return cls(
            torch.from_numpy(gram - np.diag(precision)),
            torch.from_numpy(target + gram @ at),
            constant,
            torch.from_numpy(precision),
        )

    def costs(self, sets: Sequence[tuple[int, ...]] | Tensor) -> Tensor:
        """Return F of sets of the same size, minimised over their coefficients, ``(set,)``.

        Args:
            sets: indices of candidates, also as a tensor ``(set, size)``.
        """
        if not len(sets[0]):
            return torch.tensor([self.constant], dtype=torch.float64)
        chosen = torch.as_tensor(sets)
        gram, target = self.scaled
        gains = []
        for part in chosen.split(CHUNK):
            right = target[part]
            solved = torch.linalg.solve(gram[part[:, :, None], part[:, None, :]], right[..., None])
            gains.append((solved[..., 0] * right).sum(dim=1))
        return self.constant - torch.cat(gains)

    @cached_property
    def scaled(self) -> tuple[Tensor, Tensor]:
        """``G + P`` with a diagonal of 1 and a small ridge, and g in the same scale."""
        gram = self.gram + torch.diag(self.precision)
        size = gram.diagonal().sqrt()
        ridge = RIDGE * torch.eye(len(size), dtype=torch.float64)
        return gram / size[:, None] / size + ridge, self.target / size

    def coefficients(self, chosen: tuple[int, ...]) -> Tensor:
        """Return the ξ that minimises F for one set, ``(len(chosen),)``."""
        index = list(chosen)
        matrix = self.gram[index][:, index] + torch.diag(self.precision[index])
        return solve(matrix, self.target[index, None])[:, 0]

    def most_distinct(self, count: int) -> tuple[int, ...]:
        """Return the ``count`` candidates with the most distinct effects per prior std.

        They are chosen by QR with column pivoting. A square root of the Gram matrix
        has the same pivots as the columns, and is smaller.
        """
        scaled = self.gram / self.precision.sqrt()[:, None] / self.precision.sqrt()
        values, vectors = torch.linalg.eigh(scaled)
        root = vectors * values.clamp(min=0).sqrt()
        _, pivots = qr(root.T.numpy(), mode="r", pivoting=True)
        return tuple(sorted(pivots[:count].tolist()))


def small_sets(count: int, largest: int) -> Iterator[Tensor]:
    """Yield all sets of up to ``largest`` of ``count`` candidates, ``(set, size)``, by size."""
    for size in range(largest + 1):
        members = chain.from_iterable(combinations(range(count), size))
        shape = math.comb(count, size), size
        yield torch.from_numpy(np.fromiter(members, np.int64, math.prod(shape)).reshape(shape))


def backward_path(problem: ProfiledProblem, largest: int) -> list[tuple[int, ...]]:
    """Return the sets of backward elimination that have up to ``largest`` candidates.

    Each step drops the candidate whose omission raises F least. The path reaches sets that are too
    large to enumerate.
    """
    gram, target = (tensor.numpy() for tensor in problem.scaled)
    remaining = np.arange(len(target))
    path: list[tuple[int, ...]] = []
    inverse = np.linalg.inv(gram)
    xi, fresh = inverse @ target, inverse.diagonal().copy()
    for last in range(len(target) - 1, -1, -1):
        if last < largest:
            path.append(tuple(sorted(remaining.tolist())))
        # The rise of F when candidate j is dropped: ξⱼ²/(G⁻¹)ⱼⱼ.
        dropped = int((np.square(xi) / inverse.diagonal()).argmin())
        column, pivot, effect = inverse[dropped].copy(), inverse[dropped, dropped], xi[dropped]
        # The last candidate takes the place of the one that is dropped.
        for values in (remaining, xi, fresh, column, inverse, inverse.T):
            values[dropped] = values[last]
        remaining, fresh, column = remaining[:last], fresh[:last], column[:last]
        inverse = inverse[:last, :last] - np.outer(column, column / pivot)
        xi = xi[:last] - column * (effect / pivot)
        # This is also true if rounding has made an element negative.
        if (LARGEST_DECREASE * inverse.diagonal() < fresh).any():
            inverse = np.linalg.inv(gram[np.ix_(remaining, remaining)])
            xi, fresh = inverse @ target[remaining], inverse.diagonal().copy()
    return path


def most_distinct_candidates(
    objective: LeastSquaresProblem, phi: Tensor, samples: int, count: int
) -> tuple[int, ...]:
    """Return the candidates with the most distinct effects, over a stretch beyond the horizon.

    If the run blows up there, the horizon itself is used; if it blows up too, there are none.

    Args:
        objective: F of all candidates over the whole record.
        phi: a fit up to the horizon, ``(unknown,)``.
        samples: the horizon.
        count: number of candidates.
    """
    all_members = tuple(range(len(objective.prior_std)))
    if count >= len(all_members):
        return all_members
    for samples_ahead in (LOOKAHEAD * samples, samples):
        window = objective.truncate(min(len(objective.recorded), samples_ahead))
        normal = window.linearise(phi)
        if normal.is_finite:
            profiled = ProfiledProblem.from_normal_equations(normal, objective.modes)
            return profiled.most_distinct(count)
    return ()
