"""Whether a time step is stable: an unstable one amplifies rounding errors at the grid scale.

A few samples do not show it. The growth of a small random perturbation is measured by power
iteration along the simulation, with a step and with half of it. Where the simulator itself is
unstable, both grow alike; where only the method is, they do not.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple

import torch
from torch import Tensor

from dashred.physics.expressions.reflection import side
from dashred.physics.solvers.simulate import simulate
from dashred.physics.system import System

# Steps between two normalisations, and normalisations. The second half measures the growth.
STEPS, ROUNDS = 16, 16
# Size of the perturbation, as a share of the largest value of each field.
SIZE = 1e-7
# Allowed growth over the record by the method alone: rounding errors stay small.
ALLOWED = math.log(1e4)
# Smallest value that counts as the size of a field, and seed of the perturbation.
SMALLEST, SEED = 1e-100, 0
# A step of this share of the time step is stable with any method.
SHORT = 1e-6


class Along(NamedTuple):
    """States of a simulation, from which perturbations grow.

    Attributes:
        states: ``(state, field, *grid)``.
        times: of each, ``(state,)``.
        end: of the record.
        duration: of the record.
    """

    states: Tensor
    times: Tensor
    end: float
    duration: float


def _no_limit() -> None:
    """The time of the check is small against that of what follows."""


def is_stable(system: System, along: Along, check_time: Callable[[], None] = _no_limit) -> bool:
    """Return whether rounding errors stay small over the record.

    Args:
        system: with the time step in question.
        along: states of a simulation. Those too close to the end of the record do not count, and
            neither do those beside which the equations are undefined, such as an empty tank with
            an outflow ``sqrt(h)``.
        check_time: called now and then; it may raise an error.
    """
    span = STEPS * system.dt
    reach = along.states.abs().transpose(0, 1).flatten(1).amax(dim=1)
    reach = torch.where(reach > 0, reach, reach.max().clamp(min=SMALLEST))
    sizes = reach.reshape(-1, *(1,) * (along.states.dim() - 2))
    for state, t in zip(along.states[:, None], along.times.tolist(), strict=True):
        if t + span > along.end:
            continue
        base = state, sizes, torch.tensor([t, t + span], dtype=torch.float64), check_time
        by_step = _growth(system, *base) * along.duration / span
        if by_step <= ALLOWED:
            continue
        own = _growth(system.with_step(system.dt / 2), *base) * along.duration / span
        # Written with "not", because both may be infinite.
        if not abs(by_step - own) <= ALLOWED and _is_defined_beside(system, state, sizes, t):
            return False
    return True


def _growth(
    system: System, state: Tensor, sizes: Tensor, clock: Tensor, check_time: Callable[[], None]
) -> float:
    """Return the mean growth of the logarithm of a perturbation over a span of time.

    Args:
        system: the simulator.
        state: from which each span begins, ``(1, field, *grid)``.
        sizes: size of each field, ``(field, *1)``.
        clock: begin and end of the span.
        check_time: as in :func:`is_stable`.
    """
    size, change, total = _size(system), sizes * _random(system, state), 0.0
    for done in range(ROUNDS):
        check_time()
        change = change * (size / float((change / sizes).abs().max()))
        ends = simulate(system, torch.cat([state, state + change]), clock)[:, -1]
        change = ends[1:] - ends[:1]
        factor = float((change / sizes).abs().max()) / size
        if factor == 0.0:
            return -math.inf
        if not math.isfinite(factor):
            return math.inf
        if done >= ROUNDS // 2:
            total += math.log(factor)
    return total / (ROUNDS - ROUNDS // 2)


def _is_defined_beside(system: System, state: Tensor, sizes: Tensor, t: float) -> bool:
    """Return whether the tendency is finite at states on both sides of a state.

    See :func:`_growth` for the arguments.
    """
    change = sizes * _random(system, state)
    change = change * (_size(system) / float((change / sizes).abs().max()))
    h = SHORT * system.dt
    clock = torch.tensor([t, t + h], dtype=torch.float64)
    beside = torch.cat([state - change, state + change])
    return bool(simulate(system.with_step(h), beside, clock).isfinite().all())


def _size(system: System) -> float:
    """Return the size of the perturbation, as a share of that of each field."""
    return SIZE if system.program is None else max(SIZE, system.program.rounding**0.5)


def _random(system: System, state: Tensor) -> Tensor:
    """Return a random change at all scales of the grid, with the symmetry of the state."""
    grid, generator = system.grid, torch.Generator().manual_seed(SEED)
    shape = grid.own(state).shape
    change = grid.ring(torch.randn(shape, generator=generator, dtype=torch.float64))
    for axis in grid.axes:
        if axis.ends == "fixed":
            change = change * grid.sides[side(axis.name)].abs()
    return change
