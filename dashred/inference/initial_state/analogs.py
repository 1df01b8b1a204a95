"""Analogs: simulated states whose readings are nearest to the first samples of a recording.

The climatology contains every state of the ensemble. If the equations do not depend on position, it
also contains every such state shifted along the axes, because a shifted solution is a solution.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import product

import torch
from jaxtyping import Float
from torch import Tensor

from dashred.data.observation_operator import ObservationOperator
from dashred.data.sensors import Sensor
from dashred.physics.expressions.algebra import names
from dashred.physics.grids.grid import Axis
from dashred.physics.runs.ensemble import Ensemble
from dashred.physics.runs.stored_states import each_state
from dashred.physics.system import System, Term
from dashred.physics.terms.library import resolve

# Largest number of shifts of a state, over all axes.
SHIFTS = 64
# Bytes of the weights of an observation operator, at most.
WEIGHT_BYTES = 2**29


@dataclass(frozen=True)
class Analogs:
    """Analogs, the nearest first.

    Attributes:
        states: ``(analog, field, *grid)``.
        readings: readings over the window, without noise, ``(analog, time, sensor)``.
        coefficients: coefficients of the library terms in each run, ``(analog, term)``.
        misfit: mean squared misfit to the recording, in units of σ², ``(analog,)``.
    """

    states: Tensor
    readings: Tensor
    coefficients: Tensor
    misfit: Tensor


@torch.no_grad()
def nearest_analogs(
    system: System,
    ensemble: Ensemble,
    terms: Sequence[Term],
    sensors: Sequence[Sensor],
    values: Float[Tensor, "time sensor"],
    noise: Float[Tensor, " sensor"],
    count: int,
) -> Analogs:
    """Return the ``count`` analogs with the least misfit to the first samples of a recording.

    Each member contributes as few analogs as possible: states of one member at neighbouring times
    and shifts are nearly equal, and their spread does not represent the unmeasured part of a state.

    Args:
        system: the simulator.
        ensemble: simulations at the times of the recording.
        terms: the terms of the ensemble's coefficients.
        sensors: the sensors of the recording.
        values: the first samples of the sensors, which form the window; NaN where missing.
        noise: σ of each sensor.
        count: number of analogs, at most one for each member and time.
    """
    window = len(values)
    dependencies = _names(system, terms, sensors)
    shifts = _state_shifts(system, dependencies)
    shifted = [_shifted_sensor(sensor, system, shift) for shift in shifts for sensor in sensors]
    # If the equations depend on time, an analog must have the time of the first sample.
    states = ensemble.states[:, :window] if system.clock & dependencies else ensemble.states
    # Each sensor has a weight for every point of the grid.
    together = max(1, WEIGHT_BYTES // (8 * math.prod(system.grid.shape)))
    parts = [
        each_state(ObservationOperator(shifted[first : first + together], system), states)
        for first in range(0, len(shifted), together)
    ]
    read = torch.cat(parts, dim=-1).unflatten(-1, (len(shifts), len(sensors)))
    misfit = window_misfits(read, values, noise)
    best, where = misfit.min(dim=2)
    chosen = _spread_over_members(best, min(count, best.numel()))
    member, time = chosen // best.shape[1], chosen % best.shape[1]
    shift = where[member, time]
    readings = torch.stack([read[member, time + k, shift] for k in range(window)], dim=1)
    rolls = torch.tensor(shifts, dtype=torch.long).reshape(len(shifts), len(system.axes))[shift]
    rolled = [
        torch.roll(state, shift, system.grid.dims) if any(shift) else state
        for state, shift in zip(states[member, time], rolls.tolist(), strict=True)
    ]
    coefficients = ensemble.coefficients[member]
    return Analogs(torch.stack(rolled), readings, coefficients, best[member, time])


def window_misfits(
    read: Float[Tensor, "member time shift sensor"],
    values: Float[Tensor, "window sensor"],
    noise: Float[Tensor, " sensor"],
) -> Float[Tensor, "member begin shift"]:
    """Return ``mean ((Hv − y)/σ)²`` over the available readings of each window."""
    begins = read.shape[1] - len(values) + 1
    available = ~values.isnan()
    weights = available / noise.square() / available.sum().clamp(min=1)
    total = read.new_zeros((len(read), begins, read.shape[2]))
    for k, (now, weight) in enumerate(zip(values.nan_to_num(), weights, strict=True)):
        total += (read[:, k : k + begins] - now).square() @ weight
    return total


def _spread_over_members(best: Float[Tensor, "member begin"], count: int) -> Tensor:
    """Return flat indices of ``count`` small values, by rank within their member, then by value."""
    each = -(-count // len(best))
    values, begins = best.topk(each, dim=1, largest=False)
    flat = begins + torch.arange(len(best))[:, None] * best.shape[1]
    # The best of every member comes before the second best of any.
    order = [flat[values[:, rank].argsort(stable=True), rank] for rank in range(each)]
    chosen = torch.cat(order)[:count]
    return chosen[best.flatten()[chosen].argsort(stable=True)]


def _names(system: System, terms: Sequence[Term], sensors: Sequence[Sensor]) -> frozenset[str]:
    """Return the names in the equations, in the terms and in the quantities of the sensors."""
    quantities = dict.fromkeys(sensor.reads for sensor in sensors)
    read = [system.resolve(system.parse(name, name), name) for name in quantities]
    every = [*system.resolved.values(), *(t.expression for t in resolve(system, terms)), *read]
    # Nothing is known of a program: it may depend on position.
    places = [axis.name for axis in system.axes if system.program is not None]
    return frozenset(places).union(*map(names, every))


def _state_shifts(system: System, dependencies: frozenset[str]) -> list[tuple[int, ...]]:
    """Return shifts in grid points; only zero if the equations depend on position."""
    if not system.axes or any(axis.name in dependencies for axis in system.axes):
        return [(0,) * len(system.axes)]
    along = round(SHIFTS ** (1 / len(system.axes)))
    return list(product(*(_axis_shifts(axis, along) for axis in system.axes)))


def _axis_shifts(axis: Axis, count: int) -> range:
    """Return shifts along an axis; only zero if the axis is not periodic."""
    return range(0, axis.points, max(1, axis.points // count)) if axis.periodic else range(1)


def _shifted_sensor(sensor: Sensor, system: System, shift: tuple[int, ...]) -> Sensor:
    """Return the sensor that reads from a state what ``sensor`` reads from the shifted state."""
    places = zip(sensor.position, system.axes, shift, strict=True)
    # Only states on a ring are shifted.
    moved = ((x - n * a.spacing) % a.length if a.periodic else x for x, a, n in places)
    return replace(sensor, position=tuple(moved))
