"""First guesses of the state at every node: readings, and for the other fields a forecast."""

from __future__ import annotations

import numpy as np

from dashred.inference.segments.segments import Array
from dashred.inference.segments.state_sensors import StateSensors
from dashred.inference.segments.steps.segment_simulator import SegmentSimulator

# How far from its mean a forecast may carry a field, in its own scale.
FARTHEST = 8.0


def first_nodes(
    simulator: SegmentSimulator, sensors: StateSensors, start: Array, scale: Array
) -> list[Array]:
    """Return first guesses of the nodes, ``(segment, field)`` each.

    A field that a sensor reads is taken from the readings. The others are forecast from node to
    node by the uncorrected simulator, in which the measured fields are set to the readings at each
    node. A second guess keeps them at their start, because a forecast may diverge.

    Args:
        simulator: of the segments.
        sensors: what they read.
        start: expected states at the first samples, ``(episode, field)``.
        scale: standard deviation of every field over the record, ``(field,)``.
    """
    segments = simulator.segments
    nodes = np.full((segments.count, simulator.fields), np.nan)
    for field in set(sensors.fields[sensors.fields >= 0].tolist()):
        nodes[:, field] = _read(simulator, sensors, field)
    known = np.isfinite(nodes)
    still = np.where(known, nodes, start[segments.episode])
    if known.all():
        return [nodes]
    current = start[0]
    for k in range(segments.count):
        if k == 0 or not segments.follows[k - 1]:
            current = start[segments.episode[k]]
        nodes[k] = np.where(known[k], nodes[k], current)
        if k + 1 < segments.count and segments.follows[k]:
            current = _bounded(simulator.forecast(nodes[k], k), nodes[k], start.mean(0), scale)
    return [nodes, still]


def _read(simulator: SegmentSimulator, sensors: StateSensors, field: int) -> Array:
    """Return the mean reading of a field at every node, gaps bridged by straight lines."""
    segments, found = simulator.segments, np.empty(simulator.segments.count)
    columns = sensors.fields_of(segments.readings)[:, :, sensors.fields == field]
    count = np.isfinite(columns).sum(axis=-1)
    mean = np.nansum(columns, axis=-1) / np.maximum(count, 1)
    for episode in range(int(segments.episode[-1]) + 1):
        mine = segments.episode == episode
        seen = count[mine] > 0
        clock, values = segments.times[mine][seen], mean[mine][seen]
        begins = segments.times[mine][:, 0]
        found[mine] = np.interp(begins, clock, values) if len(clock) else np.nan
    return found


def _bounded(forecast: Array, before: Array, mean: Array, scale: Array) -> Array:
    if not np.isfinite(forecast).all() or (np.abs(forecast - mean) > 20 * scale).any():
        forecast = before
    bounded: Array = np.clip(forecast, mean - FARTHEST * scale, mean + FARTHEST * scale)
    return bounded
