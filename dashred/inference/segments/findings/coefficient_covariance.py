"""Covariance of the coefficients of a law over segments, with the states at their best.

G is the matrix of the profiled problem, from which all nodes are eliminated, and g_t the derivative
of a reading's residual by the coefficients, with the nodes following. Noise that is correlated from
sample to sample, ``r_t = ρ r_{t-1} + e_t``, leaves the estimate unbiased and changes its
covariance::

    cov = s² G⁻¹ (G + Σ_sensors Σ_{t≠t'} ρ^|t-t'| g_t g_t'ᵀ) G⁻¹

(White, *Econometrica* 48, 1980, with the correlation of a first-order process).
"""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from dashred.core.numerics.block_tridiagonal import BlockNormal
from dashred.inference.segments.point import Linearisation
from dashred.inference.segments.segments import Array
from dashred.inference.segments.selection.correlated_noise import residual_moments
from dashred.inference.segments.selection.search import SegmentSearch
from dashred.inference.segments.selection.set_selection import SegmentLaw


def coefficient_covariance(
    search: SegmentSearch, law: SegmentLaw
) -> tuple[Array, BlockNormal | None]:
    """Return the covariance, infinite if it cannot be computed, and the normal equations.

    Args:
        search: gives the problem and s².
        law: the law.

    Returns:
        The covariance of its coefficients and then of the uncertain parameters, ``(unknown,
        unknown)``; and the normal equations about the law, None if it blows up.
    """
    problem, point, members = search.problem, law.fit.point, law.members
    count = len(members) + problem.parameters.count
    infinite = np.full((count, count), np.inf)
    slopes = problem.derivatives(point, members)
    if slopes is None:
        return infinite, None
    normal = problem.normal_equations(slopes, point, members)
    profiled = normal.profiled()
    if profiled is None or not count:
        return infinite, normal
    gram = profiled[0]
    scale = np.sqrt(np.maximum(gram.diagonal(), 1e-300))
    inverse = np.linalg.pinv(gram / scale[:, None] / scale, hermitian=True)
    inverse = inverse / scale[:, None] / scale
    added = _correlated_part(search, law, slopes, normal)
    return search.level * (inverse + inverse @ added @ inverse), normal


def _correlated_part(
    search: SegmentSearch, law: SegmentLaw, slopes: Linearisation, normal: BlockNormal
) -> Array:
    """Return ``Σ ρ^|t-t'| g_t g_t'ᵀ`` over pairs of different samples, ``(unknown, unknown)``."""
    problem, segments = search.problem, search.problem.segments
    correlation = residual_moments(problem, law.members, law.fit).correlation
    response = normal.node_response() if correlation.any() else None
    width = len(normal.corner)
    if response is None:
        return np.zeros((width, width))
    own = np.where(segments.noisy[..., None], slopes.readings / problem.noise_stds[..., None], 0.0)
    inner = response.shape[1]
    whole = own[..., inner:] + np.einsum("ktsf,kfj->ktsj", own[..., :inner], response)
    added = np.zeros((width, width))
    for episode in range(len(segments.begins)):
        series = segments.join(whole, episode)
        before = np.zeros(series.shape[1:])
        for last, row in pairwise(series):
            before = correlation[:, None] * (before + last)
            pairs = row.T @ before
            added += pairs + pairs.T
    return added
