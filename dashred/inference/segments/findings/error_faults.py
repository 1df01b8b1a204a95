"""Sensor errors of a segment search as faults: their kind, size and curve."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dashred.core.numerics.block_tridiagonal import BlockNormal
from dashred.inference.fit.law import ErrorCurve, SensorFault
from dashred.inference.segments.segments import Array
from dashred.inference.segments.selection.search import SegmentSearch
from dashred.inference.segments.selection.set_selection import SegmentLaw

# Largest number of times at which a curve is reported.
REPORTED = 101
# Values of the episodes are one value if their χ² per degree of freedom is below this limit.
ALIKE = 4.0


@dataclass(frozen=True)
class _Walked:
    """The walk of one sensor's error.

    Attributes:
        mean: value and slope in every segment, ``(segment, 2)``.
        covariance: posterior covariance, ``(segment, 2, 2)``.
    """

    mean: Array
    covariance: Array


def error_faults(
    search: SegmentSearch, law: SegmentLaw, normal: BlockNormal | None
) -> tuple[SensorFault, ...]:
    """Return the faults beside a law.

    A bias or a drift that differs between the episodes is told as wandering.

    Args:
        search: gives the problem and the sensor errors.
        law: a set of candidates and its fit.
        normal: the problem linearised there; None if a segment blows up.
    """
    if not search.errors:
        return ()
    problem, point = search.problem, law.fit.point
    fields, faults = problem.simulator.fields, []
    for place, (cause, level) in enumerate(search.errors.items()):
        own = [2 * place, 2 * place + 1]
        covariance = None if normal is None else normal.covariance([fields + j for j in own])
        if covariance is None:
            covariance = np.full((len(point.nodes), 2, 2), np.inf)
        walked = _Walked(point.walked[:, own], search.level * covariance)
        name = problem.sensors.names[cause.index]
        faults.append(_steady(search, walked, level.name, name) or _curved(search, walked, name))
    return tuple(faults)


def _steady(search: SegmentSearch, walked: _Walked, kind: str, name: str) -> SensorFault | None:
    """Return a bias or a drift; None if it is another kind or differs between the episodes."""
    if kind == "wandering":
        return None
    component, begins = int(kind == "drift"), search.problem.segments.begins
    value = walked.mean[begins, component]
    weight = 1 / walked.covariance[begins, component, component]
    mean = float((weight * value).sum() / weight.sum())
    spread = float((weight * np.square(value - mean)).sum())
    if spread > ALIKE * max(1, len(value) - 1):
        return None
    return SensorFault(kind, name, mean, float(weight.sum() ** -0.5), None)


def _curved(search: SegmentSearch, walked: _Walked, name: str) -> SensorFault:
    """Return the curves of a wandering sensor, and its largest error."""
    segments = search.problem.segments
    since = segments.times - segments.times[:, :1]
    row = np.stack([np.ones_like(since), since], axis=-1)
    value = np.einsum("kic,kc->ki", row, walked.mean)
    std = np.sqrt(np.maximum(np.einsum("kic,kcd,kid->ki", row, walked.covariance, row), 0))
    curves = []
    for episode in range(len(segments.begins)):
        joined = [segments.join(each, episode) for each in (segments.times, value, std)]
        count = min(len(joined[0]), REPORTED)
        chosen = np.linspace(0, len(joined[0]) - 1, count).round().astype(int)
        clock, values, stds = (tuple(each[chosen].tolist()) for each in joined)
        curves.append(ErrorCurve(clock, values, stds, episode))
    pairs = [pair for each in curves for pair in zip(each.value, each.std, strict=True)]
    largest, error = max(pairs, key=lambda pair: abs(pair[0]))
    return SensorFault("wandering", name, largest, error, None, curves=tuple(curves))
