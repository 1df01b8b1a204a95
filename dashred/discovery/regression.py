"""Sparse regression of a latent target on candidate columns, with block statistics."""

from __future__ import annotations

import warnings
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from pysindy.optimizers import SSR, STLSQ
from sklearn.linear_model import lars_path_gram

FOLDS = 5
# Directions of the Gram matrix below this share of the largest are rounding errors.
RANK_TOLERANCE = 1e-10

Array = NDArray[np.float64]
Support = tuple[int, ...]


@dataclass(frozen=True)
class Blocks:
    """A regression problem, summed up block by block: ``A ξ ≈ b`` in normal equations.

    Attributes:
        gram: ``AᵀA`` of each block, ``(block, term, term)``.
        moment: ``Aᵀb``, ``(block, term)``.
        power: ``bᵀb``, ``(block,)``.
        rows: rows in each block, ``(block,)``.
    """

    gram: Array
    moment: Array
    power: Array
    rows: Array

    @classmethod
    def of(cls, target: Array, columns: Array) -> Blocks:
        """Sum up targets ``(block, row)`` and columns ``(block, term, row)``."""
        return cls(
            np.einsum("bir,bjr->bij", columns, columns),
            np.einsum("bir,br->bi", columns, target),
            np.einsum("br,br->b", target, target),
            np.full(len(target), target.shape[1], dtype=np.float64),
        )

    def columns(self, index: NDArray[np.intp], factors: Array) -> Blocks:
        """Return the problem of some columns alone, each multiplied by a factor."""
        gram = self.gram[:, index[:, None], index] * factors * factors[:, None]
        return Blocks(gram, self.moment[:, index] * factors, self.power, self.rows)

    def weighted(self, weights: Array) -> Blocks:
        """Return the same problem with each block counted ``weights`` times, ``(block,)``."""
        w = weights[:, None]
        return Blocks(
            self.gram * w[:, None], self.moment * w, self.power * weights, self.rows * weights
        )


@dataclass(frozen=True)
class SparseFit:
    """What the regression proposes.

    Attributes:
        coefficients: in the terms' own units, ``(term,)``; zero outside the proposed set.
        contribution: size of each term's column times its coefficient, as a share of the target.
        inclusion: share of block-bootstrap draws in which STLSQ keeps the term.
        path: (number of terms, RMSE as a share of the target's rms) along the sparsity path.
        ranking: term indices, the best supported first.
    """

    coefficients: Array
    contribution: Array
    inclusion: Array
    path: list[tuple[int, float]]
    ranking: list[int]


def sparse_fit(
    blocks: Blocks, threshold: float, bootstraps: int, rng: np.random.Generator
) -> SparseFit:
    """Propose a sparse set of terms.

    Candidates are PySINDy's STLSQ, the sets along its SSR path and those along the L1 (LARS)
    path. The proposal is the smallest candidate whose block-cross-validated error is within one
    standard error of the best (Hastie, Tibshirani & Friedman, *Elements*, §7.10), the empty set
    included: no known answer enters anywhere.

    Args:
        blocks: the problem; blocks are what is left out and redrawn as a whole.
        threshold: of STLSQ, on a term's share of the target.
        bootstraps: block-bootstrap draws.
        rng: of the draws.
    """
    norms = np.sqrt(np.einsum("bii->i", blocks.gram))
    target = np.sqrt(blocks.power.sum())
    # A term that moves no sensor has an empty column: nothing can be said of it.
    seen = np.flatnonzero(norms > 1e-12 * max(norms.max(), 1e-300))
    factors = target / norms[seen]
    scaled = blocks.columns(seen, factors)
    candidates = _candidates(scaled, threshold)
    chosen = _refit(scaled, _one_standard_error(scaled, candidates))
    share, coefficients, inclusion, kept = (np.zeros(len(norms)) for _ in range(4))
    share[seen], coefficients[seen] = np.abs(chosen), chosen * factors
    inclusion[seen] = _inclusion(scaled, threshold, bootstraps, rng)
    kept[seen] = np.abs(_stlsq(scaled, threshold))
    order = np.lexsort((-kept, -inclusion, -(share != 0).astype(float)))
    ranking = [int(j) for j in order]
    return SparseFit(coefficients, share, inclusion, _path(scaled, candidates), ranking)


def _candidates(blocks: Blocks, threshold: float) -> list[Support]:
    supports: set[Support] = {(), _support(_stlsq(blocks, threshold))}
    supports.update(_ssr_path(blocks))
    supports.update(_l1_path(blocks))
    return sorted(supports, key=lambda support: (len(support), support))


def _stlsq(blocks: Blocks, threshold: float) -> Array:
    matrix, target = _square_root(blocks)
    with warnings.catch_warnings():
        # PySINDy warns when every term falls below the threshold: for a null, that is the answer.
        warnings.simplefilter("ignore")
        return STLSQ(threshold=threshold, alpha=1e-8).fit(matrix, target).coef_[0]


def _ssr_path(blocks: Blocks) -> Iterable[Support]:
    matrix, target = _square_root(blocks)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        found = SSR(alpha=1e-8, max_iter=matrix.shape[1] - 1).fit(matrix, target)
    return [_support(step[0]) for step in found.history_]


def _l1_path(blocks: Blocks) -> Iterable[Support]:
    gram, moment = blocks.gram.sum(axis=0), blocks.moment.sum(axis=0)
    with warnings.catch_warnings():
        # Near-collinear columns end the path early; what was found until then stands.
        warnings.simplefilter("ignore")
        rows = int(blocks.rows.sum())
        _, _, path = lars_path_gram(moment, gram, n_samples=rows, method="lasso", max_iter=40)
    return [_support(step) for step in path.T]


def _square_root(blocks: Blocks) -> tuple[Array, Array]:
    """Return the small problem with the same normal equations: ``R ξ ≈ z``, R square."""
    values, vectors = np.linalg.eigh(blocks.gram.sum(axis=0))
    root = np.sqrt(np.clip(values, RANK_TOLERANCE * values[-1], None))
    matrix = root[:, None] * vectors.T
    target = (vectors.T @ blocks.moment.sum(axis=0)) / root
    return matrix, target[:, None]


def _support(coefficients: Array) -> Support:
    return tuple(int(j) for j in np.flatnonzero(coefficients))


def _refit(blocks: Blocks, support: Support) -> Array:
    """Return the least-squares coefficients on a support, zero elsewhere."""
    coefficients = np.zeros(blocks.moment.shape[1])
    if support:
        index = list(support)
        gram = blocks.gram.sum(axis=0)[np.ix_(index, index)]
        moment = blocks.moment.sum(axis=0)[index]
        coefficients[index] = np.linalg.lstsq(gram, moment, rcond=RANK_TOLERANCE)[0]
    return coefficients


def _errors(blocks: Blocks, coefficients: Array) -> Array:
    """Return the squared error of each block."""
    fitted = np.einsum("i,bij,j->b", coefficients, blocks.gram, coefficients)
    return blocks.power - 2 * blocks.moment @ coefficients + fitted


def _one_standard_error(blocks: Blocks, candidates: list[Support]) -> Support:
    fold = np.arange(len(blocks.power)) * FOLDS // len(blocks.power)
    errors = np.zeros((len(candidates), len(blocks.power)))
    for k in range(FOLDS):
        training = blocks.weighted((fold != k).astype(float))
        for i, support in enumerate(candidates):
            left_out = _errors(blocks, _refit(training, support))
            errors[i, fold == k] = left_out[fold == k]
    means = errors.mean(axis=1)
    best = int(means.argmin())
    excess = errors - errors[best]
    by_fold = np.array([excess[:, fold == k].mean(axis=1) for k in range(FOLDS)])
    margins = means[best] + by_fold.std(axis=0, ddof=1) / np.sqrt(FOLDS)
    within = zip(candidates, means, margins, strict=True)
    return next(support for support, mean, margin in within if mean <= margin)


def _inclusion(
    blocks: Blocks, threshold: float, bootstraps: int, rng: np.random.Generator
) -> Array:
    kept = np.zeros(blocks.moment.shape[1])
    count = len(blocks.power)
    for _ in range(bootstraps):
        drawn = np.bincount(rng.integers(count, size=count), minlength=count).astype(float)
        kept += _stlsq(blocks.weighted(drawn), threshold) != 0
    return kept / bootstraps


def _path(blocks: Blocks, candidates: list[Support]) -> list[tuple[int, float]]:
    power = blocks.power.sum()
    best: dict[int, float] = {}
    for support in candidates:
        error = float(_errors(blocks, _refit(blocks, support)).sum() / max(power, 1e-300))
        rmse = float(np.sqrt(max(error, 0.0)))
        best[len(support)] = min(best.get(len(support), np.inf), rmse)
    return sorted(best.items())
