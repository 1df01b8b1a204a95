"""Sparse regression of a latent target on candidate columns, with block statistics."""

from __future__ import annotations

import warnings
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from pysindy.optimizers import SSR, STLSQ
from sklearn.linear_model import lars_path_gram

from dashred.inference.latent_sindy.blocks import Array, Blocks

FOLDS = 5
# Directions of the Gram matrix below this share of the largest are rounding errors.
RANK_TOLERANCE = 1e-10
# Squared errors below this share of the target's square are rounding errors.
ROUNDING = 1e-20

Support = tuple[int, ...]


@dataclass(frozen=True)
class SparseFit:
    """What the regression proposes.

    Attributes:
        coefficients: in the terms' own units, ``(term,)``; zero outside the proposed set.
        contribution: size of each term's column times its coefficient, as a share of the target.
        inclusion: share of block-bootstrap draws in which STLSQ keeps the term.
        path: (number of terms, RMSE as a share of the target's rms) along the sparsity path.
        ranking: term indices, the proposed ones first, each group in the order of forward
            selection.
        blocks: how many were left out and redrawn as a whole.
    """

    coefficients: Array
    contribution: Array
    inclusion: Array
    path: list[tuple[int, float]]
    ranking: list[int]
    blocks: int


def sparse_fit(
    blocks: Blocks, threshold: float, bootstraps: int, rng: np.random.Generator
) -> SparseFit:
    """Propose a sparse set of terms.

    Candidates are PySINDy's STLSQ, the sets along its SSR path, those along the L1 (LARS) path,
    those of forward selection and the best pair. The proposal is the smallest candidate, the
    empty set included, whose block-cross-validated error is close to the best: within
    √(1 + 2 ln terms) standard errors of their log ratio (one, for a single term: Hastie,
    Tibshirani & Friedman, *Elements*, §7.10; Donoho & Johnstone's allowance for many), or within
    what one term at the threshold would explain. The second rule is for errors that repeat in
    every block, the simulator's numerical ones and those of linearising, which cross-validation
    takes for physics.

    Args:
        blocks: the problem; blocks are what is left out and redrawn as a whole.
        threshold: on a term's share of the target, of STLSQ and of the choice.
        bootstraps: block-bootstrap draws; without any, inclusion stays zero.
        rng: of the draws.
    """
    norms = np.sqrt(np.einsum("bii->i", blocks.gram))
    target = np.sqrt(blocks.power.sum())
    # A term that moves no sensor has an empty column: nothing can be said of it.
    seen = np.flatnonzero(norms > 1e-12 * max(norms.max(), 1e-300))
    if not len(seen) or not target:
        nothing = np.zeros(len(norms))
        return SparseFit(
            nothing, nothing, nothing, [(0, 1.0)], list(range(len(norms))), len(blocks.power)
        )
    factors = target / norms[seen]
    scaled = blocks.columns(seen, factors)
    order = _forward_order(scaled)
    candidates = _candidates(scaled, threshold, order)
    chosen = _refit(scaled, _smallest_sufficient(scaled, candidates, threshold))
    share, coefficients, inclusion = (np.zeros(len(norms)) for _ in range(3))
    share[seen], coefficients[seen] = np.abs(chosen), chosen * factors
    inclusion[seen] = _inclusion(scaled, threshold, bootstraps, rng)
    place = np.full(len(norms), len(norms))
    place[seen[order]] = np.arange(len(seen))
    ranking = [int(j) for j in np.lexsort((place, share == 0))]
    path = _path(scaled, candidates)
    return SparseFit(coefficients, share, inclusion, path, ranking, len(blocks.power))


def _candidates(blocks: Blocks, threshold: float, order: list[int]) -> list[Support]:
    supports: set[Support] = {(), _support(_stlsq(blocks, threshold))}
    supports.update(_ssr_path(blocks))
    supports.update(_l1_path(blocks))
    supports.update(tuple(sorted(order[:size])) for size in range(1, len(order) + 1))
    supports.add(_best_pair(blocks))
    return sorted(supports, key=lambda support: (len(support), support))


def _forward_order(blocks: Blocks) -> list[int]:
    """Order all terms by what each adds to those before it (orthogonal least squares).

    Chen, Billings & Luo (1989). PySINDy's FROLS is the same in loops over columns, which a full
    order of forty terms makes the dearest part of an epoch.
    """
    gram, moment = blocks.gram.sum(axis=0), blocks.moment.sum(axis=0)
    least = RANK_TOLERANCE * gram.diagonal().copy()
    order: list[int] = []
    left = list(range(len(moment)))
    while left:
        power = gram.diagonal()
        # What is left of a column that earlier ones span is rounding error: it adds nothing.
        gain = np.where(power > least, moment**2 / np.maximum(power, least), -1.0)
        j = max(left, key=gain.__getitem__)
        order.append(j)
        left.remove(j)
        if gain[j] >= 0:
            share = gram[:, j] / gram[j, j]
            moment = moment - share * moment[j]
            gram = gram - np.outer(share, gram[j])
    return order


def _best_pair(blocks: Blocks) -> Support:
    """Return the two terms that explain most; forward selection misses two that nearly cancel."""
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


def _smallest_sufficient(blocks: Blocks, candidates: list[Support], threshold: float) -> Support:
    count = len(blocks.power)
    if count == 1:
        # Nothing is left out to learn from: no set is worth a term more.
        return candidates[0]
    fold = np.arange(count) * FOLDS // count
    errors = np.zeros((len(candidates), count))
    for k in range(FOLDS):
        training = blocks.pooled(fold != k)
        for i, support in enumerate(candidates):
            left_out = _errors(blocks, _refit(training, support))
            errors[i, fold == k] = left_out[fold == k]
    means = errors.mean(axis=1)
    best = int(means.argmin())
    # A front passes in some blocks and not in others: differences would be those few blocks',
    # so ratios are compared, down to what counts as an error at all.
    floor = threshold**2 * blocks.power + ROUNDING * blocks.power.mean()
    ratios = np.log((np.maximum(errors, 0) + floor) / (np.maximum(errors[best], 0) + floor))
    # The best of many sets beats the truth by chance, by more the more terms there are.
    luck = np.sqrt(1 + 2 * np.log(blocks.moment.shape[1]))
    by_chance = ratios.mean(axis=1) <= luck * ratios.std(axis=1, ddof=1) / np.sqrt(count)
    slight = means - means[best] <= threshold**2 * blocks.power.mean()
    return next(s for s, enough in zip(candidates, by_chance | slight, strict=True) if enough)


def _inclusion(
    blocks: Blocks, threshold: float, bootstraps: int, rng: np.random.Generator
) -> Array:
    kept = np.zeros(blocks.moment.shape[1])
    count = len(blocks.power)
    for _ in range(bootstraps):
        drawn = np.bincount(rng.integers(count, size=count), minlength=count).astype(float)
        kept += _stlsq(blocks.weighted(drawn), threshold) != 0
    return kept / max(1, bootstraps)


def _path(blocks: Blocks, candidates: list[Support]) -> list[tuple[int, float]]:
    blocks = blocks.pooled(blocks.power >= 0)
    power = blocks.power.sum()
    best: dict[int, float] = {}
    for support in candidates:
        error = float(_errors(blocks, _refit(blocks, support)).sum() / max(power, 1e-300))
        rmse = float(np.sqrt(max(error, 0.0)))
        best[len(support)] = min(best.get(len(support), np.inf), rmse)
    return sorted(best.items())
