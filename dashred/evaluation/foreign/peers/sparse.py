"""Sparse regression whose threshold is chosen by the Bayesian information criterion."""

from __future__ import annotations

import math
import warnings
from collections.abc import Callable
from typing import Any

import numpy as np

from dashred.evaluation.foreign.cases.case import Array

# Thresholds for columns and targets normalised to one.
THRESHOLDS = tuple(np.geomspace(1e-2, 2.0, 16))


def sparse_law(columns: Array, target: Array, optimizer: Callable[[float], Any]) -> Array:
    """Return the coefficients of the columns ``(row, column)``.

    Of the laws of all thresholds the one of least ``n ln(RSS/n) + k (ln n + 2 ln p)`` is taken,
    with n rows, p columns and k terms, each refitted by least squares.

    Args:
        columns: candidate terms.
        target: ``(row,)``.
        optimizer: returns the regression of PySINDy for a threshold.
    """
    rows, count = columns.shape
    size = np.linalg.norm(columns, axis=0).clip(min=1e-300)
    rate = float(np.linalg.norm(target)) or 1.0
    penalty = math.log(rows) + 2 * math.log(count)
    laws = [np.zeros(count)]
    with warnings.catch_warnings():
        # PySINDy warns when every term falls below the threshold.
        warnings.simplefilter("ignore")
        for threshold in THRESHOLDS:
            fitted = optimizer(float(threshold))
            fitted.fit(columns / size, target[:, None] / rate)
            support = np.flatnonzero(np.asarray(fitted.coef_)[0])
            law = np.zeros(count)
            law[support] = np.linalg.lstsq(columns[:, support], target, rcond=None)[0]
            laws.append(law)

    def criterion(law: Array) -> float:
        residual = float(np.mean((target - columns @ law) ** 2))
        return rows * math.log(max(residual, 1e-300)) + penalty * int(np.count_nonzero(law))

    return min(laws, key=criterion)
