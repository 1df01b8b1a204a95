"""Sparse regression of a latent target on candidate columns, with block statistics."""

from __future__ import annotations

import warnings
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace

import numpy as np
from pysindy.optimizers import SSR, STLSQ
from scipy.linalg.lapack import dpocon, dpotrf, dpotrs
from sklearn import config_context
from sklearn.linear_model import lars_path_gram

from dashred.inference.latent_sindy.blocks import Array, Blocks

FOLDS = 5
# Larger sets are not sparse, and cross-validation of them would take most of the time.
LARGEST_SET = 12
# Directions of the Gram matrix below this share of the largest are rounding errors.
RANK_TOLERANCE = 1e-10
# A Gram matrix with a larger reciprocal condition number is solved by Cholesky, which is faster.
WELL_CONDITIONED = 1e-8
# Squared errors below this share of the target's square are rounding errors.
ROUNDING = 1e-20

Support = tuple[int, ...]


@dataclass(frozen=True)
class SparseFit:
    """The proposal of a sparse regression.

    Attributes:
        coefficients: in the units of the terms, ``(term,)``; zero outside the proposed set.
        contribution: norm of coefficient times column, as a share of the norm of the target.
        inclusion: share of block-bootstrap draws in which STLSQ includes the term.
        path: (number of terms, RMSE as a share of the rms of the target) of the best sets.
        ranking: term indices, proposed terms first; each group in the order of forward selection.
        blocks: number of blocks.
    """

    coefficients: Array
    contribution: Array
    inclusion: Array
    path: list[tuple[int, float]]
    ranking: list[int]
    blocks: int

    def with_law(self, coefficients: Array, blocks: Blocks) -> SparseFit:
        """Return the proposal with another law, ``(term,)``, that was found in another way."""
        norms, target = np.sqrt(np.einsum("bii->i", blocks.gram)), np.sqrt(blocks.power.sum())
        share = np.abs(coefficients) * norms / target if target else np.zeros_like(norms)
        ranking = sorted(self.ranking, key=lambda j: coefficients[j] == 0)
        return replace(self, coefficients=coefficients, contribution=share, ranking=ranking)


def sparse_fit(
    blocks: Blocks, threshold: float, bootstraps: int, rng: np.random.Generator
) -> SparseFit:
    """Propose a sparse set of terms.

    The candidate sets are the empty set, the sets of PySINDy's STLSQ and SSR, the sets along the L1
    path (LARS), the sets of forward selection, and the best pair, each of at most 12 terms. The
    proposal is the smallest candidate set whose error in block cross-validation is close to the
    lowest error. It is close if one of two rules holds:

    - The mean log ratio of the errors is within √(1 + 2 ln terms) standard errors. This is the
      one-standard-error rule (Hastie, Tibshirani & Friedman, *Elements*, §7.10), with the allowance
      of Donoho & Johnstone for many terms.
    - The difference is less than one term at the threshold would explain. This rule is for errors
      that repeat in every block, such as numerical errors and errors of the linearisation.
      Cross-validation alone would attribute them to terms.

    Args:
        blocks: the problem; cross-validation and bootstrap leave out and redraw whole blocks.
        threshold: smallest contribution of a term, as a share of the target.
        bootstraps: number of block-bootstrap draws; without draws, inclusion is zero.
        rng: random generator of the draws.
    """
    norms = np.sqrt(np.einsum("bii->i", blocks.gram))
    target = np.sqrt(blocks.power.sum())
    # A term without effect on the sensors has a zero column and cannot be determined.
    determined = np.flatnonzero(norms > 1e-12 * max(norms.max(), 1e-300))
    if not len(determined) or not target:
        zero = np.zeros(len(norms))
        return SparseFit(zero, zero, zero, [(0, 1.0)], list(range(len(norms))), len(blocks.power))
    factors = target / norms[determined]
    scaled = blocks.columns(determined, factors)
    order = _forward_order(scaled)
    candidates = _candidates(scaled, threshold, order)
    chosen = _refits(scaled, [_choose_support(scaled, candidates, threshold)])[0]
    share, coefficients, inclusion = (np.zeros(len(norms)) for _ in range(3))
    share[determined], coefficients[determined] = np.abs(chosen), chosen * factors
    inclusion[determined] = _inclusion(scaled, threshold, bootstraps, rng)
    place = np.full(len(norms), len(norms))
    place[determined[order]] = np.arange(len(determined))
    ranking = [int(j) for j in np.lexsort((place, share == 0))]
    path = _path(scaled, candidates)
    return SparseFit(coefficients, share, inclusion, path, ranking, len(blocks.power))


def _candidates(blocks: Blocks, threshold: float, order: list[int]) -> list[Support]:
    supports: set[Support] = {(), _support(_stlsq(blocks, threshold))}
    supports.update(_ssr_path(blocks))
    supports.update(_l1_path(blocks))
    supports.update(tuple(sorted(order[:size])) for size in range(1, len(order) + 1))
    supports.add(_best_pair(blocks))
    sparse = (support for support in supports if len(support) <= LARGEST_SET)
    return sorted(sparse, key=lambda support: (len(support), support))


def _forward_order(blocks: Blocks) -> list[int]:
    """Order all terms by forward selection (orthogonal least squares).

    Chen, Billings & Luo (1989). FROLS of PySINDy is the same method with loops over the columns. To
    order forty terms, it would be the most expensive part of an epoch.
    """
    gram, moment = blocks.gram.sum(axis=0), blocks.moment.sum(axis=0)
    least = RANK_TOLERANCE * gram.diagonal().copy()
    order: list[int] = []
    remaining = list(range(len(moment)))
    while remaining:
        power = gram.diagonal()
        # If earlier columns span a column, its remainder is a rounding error and has no gain.
        gain = np.where(power > least, moment**2 / np.maximum(power, least), -1.0)
        j = max(remaining, key=gain.__getitem__)
        order.append(j)
        remaining.remove(j)
        if gain[j] >= 0:
            share = gram[:, j] / gram[j, j]
            moment = moment - share * moment[j]
            gram = gram - np.outer(share, gram[j])
    return order


def _best_pair(blocks: Blocks) -> Support:
    """Return the best set of two terms; forward selection misses two that nearly cancel."""
    gram, m = blocks.gram.sum(axis=0), blocks.moment.sum(axis=0)
    power = np.outer(gram.diagonal(), gram.diagonal())
    determinant = power - gram**2
    cross = m[:, None] ** 2 * gram.diagonal()
    gain = cross + cross.T - 2 * np.outer(m, m) * gram
    distinct = determinant > RANK_TOLERANCE * power
    gain = np.where(distinct, gain / np.where(distinct, determinant, 1.0), 0.0)
    pair = np.unravel_index(int(gain.argmax()), gain.shape)
    return tuple(sorted({int(j) for j in pair}))


def _stlsq(blocks: Blocks, threshold: float) -> Array:
    matrix, target = _square_root(blocks)
    # PySINDy warns if no term exceeds the threshold; the empty set is a valid result.
    with _quick_and_quiet():
        return STLSQ(threshold=threshold, alpha=1e-8).fit(matrix, target).coef_[0]


def _ssr_path(blocks: Blocks) -> Iterable[Support]:
    matrix, target = _square_root(blocks)
    if matrix.shape[1] == 1:
        return [(0,)]
    with _quick_and_quiet():
        found = SSR(alpha=1e-8, max_iter=matrix.shape[1] - 1).fit(matrix, target)
    return [_support(step[0]) for step in found.history_]


@contextmanager
def _quick_and_quiet() -> Iterator[None]:
    """Leave out the checks of the input, which take longer than the regressions, and warnings."""
    quick = config_context(skip_parameter_validation=True, assume_finite=True)
    with quick, warnings.catch_warnings():
        warnings.simplefilter("ignore")
        yield


def _l1_path(blocks: Blocks) -> Iterable[Support]:
    gram, moment = blocks.gram.sum(axis=0), blocks.moment.sum(axis=0)
    with warnings.catch_warnings():
        # Nearly collinear columns end the path early; its first sets are still valid.
        warnings.simplefilter("ignore")
        rows = int(blocks.rows.sum())
        _, _, path = lars_path_gram(moment, gram, n_samples=rows, method="lasso", max_iter=40)
    return [_support(step) for step in path.T]


def _square_root(blocks: Blocks) -> tuple[Array, Array]:
    """Return a problem ``R ξ ≈ z`` with square R and the same normal equations."""
    values, vectors = np.linalg.eigh(blocks.gram.sum(axis=0))
    root = np.sqrt(np.clip(values, RANK_TOLERANCE * values[-1], None))
    matrix = root[:, None] * vectors.T
    target = (vectors.T @ blocks.moment.sum(axis=0)) / root
    return matrix, target[:, None]


def _support(coefficients: Array) -> Support:
    return tuple(int(j) for j in np.flatnonzero(coefficients))


def _refits(blocks: Blocks, supports: Sequence[Support]) -> Array:
    """Return the least-squares coefficients on each support, zero elsewhere, ``(set, term)``."""
    gram, moment = blocks.gram.sum(axis=0), blocks.moment.sum(axis=0)
    coefficients = np.zeros((len(supports), len(moment)))
    for row, support in zip(coefficients, supports, strict=True):
        if support:
            index = np.array(support)
            row[index] = _solve(gram[index[:, None], index], moment[index])
    return coefficients


def _solve(gram: Array, moment: Array) -> Array:
    """Solve normal equations: by Cholesky, or by SVD if the columns are nearly dependent."""
    factor, failed = dpotrf(gram)
    if not failed:
        share, _ = dpocon(factor, np.abs(gram).sum(axis=0).max())
        if share > WELL_CONDITIONED:
            return np.asarray(dpotrs(factor, moment)[0], dtype=np.float64)
    return np.asarray(np.linalg.lstsq(gram, moment, rcond=RANK_TOLERANCE)[0], dtype=np.float64)


def _errors(blocks: Blocks, coefficients: Array) -> Array:
    """Return the squared error of each block for coefficients ``(set, term)``, ``(set, block)``."""
    quadratic = np.einsum("bis,si->sb", blocks.gram @ coefficients.T, coefficients)
    return blocks.power - 2 * coefficients @ blocks.moment.T + quadratic


def _choose_support(blocks: Blocks, candidates: list[Support], threshold: float) -> Support:
    count = len(blocks.power)
    if count == 1:
        # One block allows no cross-validation; the candidates begin with the empty set.
        return candidates[0]
    fold = np.arange(count) * FOLDS // count
    errors = np.zeros((len(candidates), count))
    for k in range(FOLDS):
        coefficients = _refits(blocks.selected(fold != k), candidates)
        errors[:, fold == k] = _errors(blocks.selected(fold == k), coefficients)
    means = errors.mean(axis=1)
    best = int(means.argmin())
    # A front passes in some blocks only, and these would dominate the differences of errors.
    # Therefore ratios are compared, with a floor under the errors.
    floor = threshold**2 * blocks.power + ROUNDING * blocks.power.mean()
    ratios = np.log((np.maximum(errors, 0) + floor) / (np.maximum(errors[best], 0) + floor))
    # The best of many sets has a lower error than the true set by chance; more so with more terms.
    tolerance = np.sqrt(1 + 2 * np.log(blocks.moment.shape[1]))
    is_within_error = ratios.mean(axis=1) <= tolerance * ratios.std(axis=1, ddof=1) / np.sqrt(count)
    is_negligible = means - means[best] <= threshold**2 * blocks.power.mean()
    return next(
        s
        for s, is_close in zip(candidates, is_within_error | is_negligible, strict=True)
        if is_close
    )


def _inclusion(
    blocks: Blocks, threshold: float, bootstraps: int, rng: np.random.Generator
) -> Array:
    included = np.zeros(blocks.moment.shape[1])
    count = len(blocks.power)
    for _ in range(bootstraps):
        drawn = np.bincount(rng.integers(count, size=count), minlength=count).astype(float)
        included += _stlsq(blocks.weighted(drawn), threshold) != 0
    return included / max(1, bootstraps)


def _path(blocks: Blocks, candidates: list[Support]) -> list[tuple[int, float]]:
    power = max(float(blocks.power.sum()), 1e-300)
    errors = _errors(blocks, _refits(blocks, candidates)).sum(axis=1)
    best: dict[int, float] = {}
    for support, error in zip(candidates, errors, strict=True):
        rmse = float(np.sqrt(max(error / power, 0.0)))
        best[len(support)] = min(best.get(len(support), np.inf), rmse)
    return sorted(best.items())
