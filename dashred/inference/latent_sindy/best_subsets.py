"""The best set of each size within a set of terms."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations

import numpy as np

from dashred.inference.latent_sindy.blocks import Array, Blocks


def best_subsets(blocks: Blocks, support: Sequence[int]) -> list[Array]:
    """Return the coefficients of the best set of each size, from no terms to all of them.

    All ``2^n`` sets are solved, so that ``n`` has to be small (a proposal has at most 12 terms).

    Args:
        blocks: the regression problem.
        support: indices of n terms.

    Returns:
        n + 1 arrays ``(term,)``, zero outside of the set.
    """
    gram, moment = blocks.gram.sum(axis=0), blocks.moment.sum(axis=0)
    found = []
    for size in range(len(support) + 1):
        fits = [_least_squares(gram, moment, subset) for subset in combinations(support, size)]
        # Least squares lower the squared error by the inner product with the moment.
        found.append(max(fits, key=lambda fit: float(fit @ moment)))
    return found


def _least_squares(gram: Array, moment: Array, subset: tuple[int, ...]) -> Array:
    coefficients = np.zeros_like(moment)
    index = np.array(subset, dtype=np.intp)
    # Columns have very different sizes, and nearly dependent ones are common.
    size = np.sqrt(gram[index, index])
    scaled = gram[np.ix_(index, index)] / np.outer(size, size)
    coefficients[index] = np.linalg.lstsq(scaled, moment[index] / size, rcond=1e-12)[0] / size
    return coefficients
