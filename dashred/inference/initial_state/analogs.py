"""Simulated states whose continuation reads most like the beginning of a recording.

The climatology is every state of the ensemble and, where the equations do not know where they
are, every such state moved along the axes: a solution that is moved remains one.
"""

from __future__ import annotations

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
from dashred.physics.library import resolve
from dashred.physics.runs.ensemble import Ensemble
from dashred.physics.system import System, Term

MOVES = 64


@dataclass(frozen=True)
class Analogs:
    """States whose readings over the next samples are known, the likest first.

    Attributes:
        states: ``(analog, field, *grid)``.
        readings: over the window, without noise, ``(analog, time, sensor)``.
        coefficients: of the library terms that drive each, ``(analog, term)``.
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
    """Return the ``count`` analogs with the least misfit to a recording's first samples.

    As few per member as make up the count: neighbouring times and places of one member are
    nearly one state, and the spread of such twins says nothing about what is not measured.

    Args:
        system: the simulator.
        ensemble: on the recording's clock.
        terms: what the ensemble's coefficients belong to.
        sensors: those of the recording.
        values: their first samples, the window; NaN is missing.
        noise: σ of each sensor.
        count: how many analogs, at most one for each member and instant.
    """
    window = len(values)
    known = _names(system, terms, sensors)
    moves = _moves(system, known)
    moved = [_moved(sensor, system, move) for move in moves for sensor in sensors]
    # Where equations know the time, a later state has another continuation than the recording's.
    states = ensemble.states[:, :window] if system.clock & known else ensemble.states
    read = ObservationOperator(moved, system)(states)
    read = read.unflatten(-1, (len(moves), len(sensors)))
    misfit = window_misfits(read, values, noise)
    best, where = misfit.min(dim=2)
    chosen = _spread_over_members(best, min(count, best.numel()))
    member, time = chosen // best.shape[1], chosen % best.shape[1]
    move = where[member, time]
    readings = torch.stack([read[member, time + k, move] for k in range(window)], dim=1)
    shifts = torch.tensor(moves, dtype=torch.long).reshape(len(moves), len(system.axes))[move]
    rolled = [
        torch.roll(state, shift, system.grid.dims) if shift else state
        for state, shift in zip(states[member, time], shifts.tolist(), strict=True)
    ]
    coefficients = ensemble.coefficients[member]
    return Analogs(torch.stack(rolled), readings, coefficients, best[member, time])


def window_misfits(
    read: Float[Tensor, "member time move sensor"],
    values: Float[Tensor, "window sensor"],
    noise: Float[Tensor, " sensor"],
) -> Float[Tensor, "member begin move"]:
    """Return ``mean ((Hv − y)/σ)²`` over the known readings of each window."""
    begins = read.shape[1] - len(values) + 1
    known = ~values.isnan()
    weights = known / noise.square() / known.sum().clamp(min=1)
    total = read.new_zeros((len(read), begins, read.shape[2]))
    for k, (now, weight) in enumerate(zip(values.nan_to_num(), weights, strict=True)):
        total += (read[:, k : k + begins] - now).square() @ weight
    return total


def _spread_over_members(best: Float[Tensor, "member begin"], count: int) -> Tensor:
    """Return flat indices of the ``count`` least, by rank within their member, then by value."""
    each = -(-count // len(best))
    values, begins = best.topk(each, dim=1, largest=False)
    flat = begins + torch.arange(len(best))[:, None] * best.shape[1]
    # All members' first choices stand before any second one, which only fills up the count.
    order = [flat[values[:, rank].argsort(stable=True), rank] for rank in range(each)]
    chosen = torch.cat(order)[:count]
    return chosen[best.flatten()[chosen].argsort(stable=True)]


def _names(system: System, terms: Sequence[Term], sensors: Sequence[Sensor]) -> frozenset[str]:
    """Return what the equations, the terms and the sensors' quantities read."""
    quantities = dict.fromkeys(sensor.reads for sensor in sensors)
    read = [system.resolve(system.parse(name, name), name) for name in quantities]
    every = [*system.resolved.values(), *(t.expression for t in resolve(system, terms)), *read]
    return frozenset[str]().union(*map(names, every))


def _moves(system: System, known: frozenset[str]) -> list[tuple[int, ...]]:
    """Return shifts in grid points; none but the origin where the equations know places."""
    if not system.axes or any(axis.name in known for axis in system.axes):
        return [(0,) * len(system.axes)]
    along = round(MOVES ** (1 / len(system.axes)))
    return list(product(*(_shifts(axis, along) for axis in system.axes)))


def _shifts(axis: Axis, count: int) -> range:
    """Return shifts along an axis; what has ends cannot be moved."""
    return range(0, axis.points, max(1, axis.points // count)) if axis.periodic else range(1)


def _moved(sensor: Sensor, system: System, move: tuple[int, ...]) -> Sensor:
    """Return the sensor that reads of a state what ``sensor`` reads of the moved state."""
    places = zip(sensor.position, system.axes, move, strict=True)
    return replace(sensor, position=tuple((x - n * a.spacing) % a.length for x, a, n in places))
