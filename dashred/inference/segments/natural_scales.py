"""Natural scales of a weak-constraint problem, from the readings and the first guess."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from dashred.inference.forward.candidates import Candidate
from dashred.inference.segments.segment_simulator import SegmentSimulator
from dashred.inference.segments.segments import Array, Segments
from dashred.inference.segments.state_sensors import StateSensors


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
) -> NaturalScales:
    """Return the scales about some nodes.

    A field's rate is the rms of its equation's tendency, or of the readings' differences if that
    is larger: an equation may lack its largest term.

    Args:
        simulator: of the segments.
        sensors: what they read.
        candidates: terms and parameters.
        nodes: states, ``(segment, field)``.
        size: standard deviation of every field, ``(field,)``.
    """
    segments = simulator.segments
    values = sensors.fields_of(segments.readings)
    rates, terms, equations, owners = simulator.tendencies(nodes, candidates)
    rate = np.sqrt(np.square(rates).mean(axis=0))
    for sensor, field in enumerate(sensors.fields.tolist()):
        if field >= 0:
            slopes = _slopes(segments, values[:, :, sensor])
            rate[field] = max(rate[field], float(np.sqrt(np.nanmean(np.square(slopes)))))
    rate = np.maximum(rate, 1e-9 * size / segments.span)
    # A parameter may touch several equations: the one that it moves most decides.
    moved = np.sqrt(np.square(terms).mean(axis=1)) / rate[equations]
    largest = np.zeros(len(candidates))
    np.maximum.at(largest, owners, moved)
    return NaturalScales(rate, size, 1 / np.maximum(largest, 1e-12))


def _slopes(segments: Segments, values: Array) -> Array:
    """Return differences between neighbouring samples over their distance in time."""
    steps = np.diff(segments.times, axis=1)
    with np.errstate(divide="ignore", invalid="ignore"):
        found: Array = np.where(steps > 0, np.diff(values, axis=1) / steps, np.nan)
    return found if np.isfinite(found).any() else np.zeros(1)
