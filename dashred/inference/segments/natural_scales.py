"""Natural scales of a weak-constraint problem, from the readings and the first guess."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from dashred.inference.forward.candidates import Candidate
from dashred.inference.segments.segments import Array, Segments
from dashred.inference.segments.state_sensors import StateSensors
from dashred.inference.segments.steps.segment_simulator import SegmentSimulator


@dataclass(frozen=True)
class NaturalScales:
    """Sizes by which weights are chosen.

    Attributes:
        rate: rms tendency of every field, ``(field,)``.
        size: standard deviation of every field, ``(field,)``.
        coefficient: ξ at which a candidate's tendency has the rms of its equation's own,
            ``(candidate,)``.
    """

    rate: Array
    size: Array
    coefficient: Array


def field_sizes(segments: Segments, sensors: StateSensors, unread: Array) -> Array:
    """Return the standard deviation of every field over the record, ``(field,)``.

    Args:
        segments: of the record.
        sensors: what they read.
        unread: of the fields that no sensor reads, ``(field,)``.
    """
    found, values = unread.copy(), sensors.fields_of(segments.readings)
    for sensor, field in enumerate(sensors.fields.tolist()):
        if field >= 0:
            found[field] = max(float(np.nanstd(values[:, :, sensor])), 1e-12)
    return found


def natural_scales(
    simulator: SegmentSimulator,
    sensors: StateSensors,
    candidates: Sequence[Candidate],
    nodes: Array,
    size: Array,
    noise_std: Array,
) -> NaturalScales:
    """Return the scales about some nodes.

    A field's rate is the rms of its equation's tendency, or that of the readings if it is larger:
    an equation may lack its largest term. The rate of a function h of the field is divided by the
    rms of ∂h/∂x.

    Args:
        simulator: of the segments.
        sensors: what they read.
        candidates: terms and parameters.
        nodes: states, ``(segment, field)``.
        size: standard deviation of every field, ``(field,)``.
        noise_std: σ of the readings, ``(sensor,)``.
    """
    segments = simulator.segments
    values = sensors.fields_of(segments.readings)
    stds = sensors.stds_of_fields(noise_std * segments.relative)
    variances = np.broadcast_to(np.square(stds), values.shape)
    rates, terms, equations, owners = simulator.tendencies(nodes, candidates)
    rate = np.sqrt(np.square(rates).mean(axis=0))
    for sensor, field in enumerate(sensors.fields.tolist()):
        if field >= 0:
            seen = _read_rate(segments, values[:, :, sensor], variances[:, :, sensor])
            rate[field] = max(rate[field], seen)
    for sensor, field in enumerate(sensors.curved.tolist()):
        if field >= 0:
            gain = float(np.sqrt(np.square(sensors.slope_of_curved(sensor, nodes)).mean()))
            seen = _read_rate(segments, values[:, :, sensor], variances[:, :, sensor])
            rate[field] = max(rate[field], seen / gain if gain > 0 else 0.0)
    rate = np.maximum(rate, 1e-9 * size / segments.span)
    # A parameter may touch several equations: the one that it moves most decides.
    moved = np.sqrt(np.square(terms).mean(axis=1)) / rate[equations]
    largest = np.zeros(len(candidates))
    np.maximum.at(largest, owners, moved)
    return NaturalScales(rate, size, 1 / np.maximum(largest, 1e-12))


def _read_rate(segments: Segments, values: Array, variances: Array) -> float:
    """Return the rms rate of what a sensor reads, without that of its noise.

    The slopes ``s_k`` between neighbouring samples contain the noise of both. Their mean square is
    taken less that of the noise. If σ is overestimated this is too small: the mean of
    ``s_k s_(k+2)``, which have no sample in common, is then larger. Where noise hides the slopes
    of neighbours, those between samples farther apart show more; they bound the rate from below.

    Args:
        segments: of the record.
        values: readings as values of the field, ``(segment, sample)``; NaN where missing.
        variances: σ² of each, ``(segment, sample)``.
    """
    slopes, _ = _slopes(segments.times, values, variances, 1)
    squares = [slopes[:, 2:] * slopes[:, :-2]]
    lag = 1
    while lag < values.shape[1]:
        slopes, noise = _slopes(segments.times, values, variances, lag)
        squares.append(np.square(slopes) - noise)
        lag *= 2
    known = [float(np.mean(each[np.isfinite(each)])) for each in squares if np.isfinite(each).any()]
    return math.sqrt(max([0.0, *known]))


def _slopes(times: Array, values: Array, variances: Array, lag: int) -> tuple[Array, Array]:
    """Return slopes between samples so far apart, and the variance that noise gives them."""
    steps = times[:, lag:] - times[:, :-lag]
    with np.errstate(divide="ignore", invalid="ignore"):
        slopes = np.where(steps > 0, (values[:, lag:] - values[:, :-lag]) / steps, np.nan)
        noise = (variances[:, lag:] + variances[:, :-lag]) / np.square(steps)
    return slopes, noise
