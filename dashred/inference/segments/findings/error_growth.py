"""Growth of an error of the start over the record."""

from __future__ import annotations

import math

import numpy as np

from dashred.inference.segments.selection.search import SegmentSearch

# If an error of the start grows by more than this factor over the record, no single trajectory is
# fitted (natural logarithm).
CHAOTIC = math.log(1e3)


def is_chaotic(search: SegmentSearch) -> bool:
    """Return whether an error of the start grows too much to fit a single trajectory."""
    return error_growth(search) > CHAOTIC


def error_growth(search: SegmentSearch) -> float:
    """Return the natural logarithm of the largest growth of an error of the start.

    The propagators ``∂Φ(x_k)/∂x_k`` of the best law are multiplied by QR, in units of each field's
    size (Benettin et al., *Meccanica* 15, 1980). The largest value over the episodes is returned.
    """
    problem, best = search.problem, search.best
    fields = problem.simulator.fields
    point = best.fit.point
    changes = problem.changes(point, best.members)
    _, columns = problem.simulator.linearise(point.nodes, *changes)
    size = search.natural.size
    steps = columns[:, -1, :, :fields] / size[:, None] * size
    largest, grown, basis = 0.0, np.zeros(fields), np.eye(fields)
    for k, step in enumerate(steps):
        if k and not problem.segments.follows[k - 1]:
            grown, basis = np.zeros(fields), np.eye(fields)
        if not np.isfinite(step).all():
            return math.inf
        basis, triangle = np.linalg.qr(step @ basis)
        grown = grown + np.log(np.maximum(np.abs(triangle.diagonal()), 1e-300))
        largest = max(largest, float(grown.max()))
    return largest
