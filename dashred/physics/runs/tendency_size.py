"""Size of the right-hand side of every equation along a trajectory."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import partial

import numpy as np
import torch
from torch import Tensor

from dashred.physics.external.protocol import Array
from dashred.physics.program_parameters import parameter_slopes
from dashred.physics.solvers.splitting import ProgramFlow
from dashred.physics.system import System, Term
from dashred.physics.terms.column_blocks import in_blocks
from dashred.physics.terms.library import evaluate_terms

# A difference in time over this share of the time step is the rate of a program.
SHORT_STEP = 1 / 16
# Smallest rms of a tendency.
LEAST = 1e-12


def tendency_size(system: System, states: Tensor, t: float | Tensor) -> Tensor:
    """Return the rms of the right-hand side of each equation over a simulation, ``(field,)``.

    An equation that is 0 over the simulation has the size of a field that changes by its own size
    from the first time to the last. The size is positive in any case. States that a program cannot
    step do not count.

    Args:
        system: the simulator.
        states: ``(time, field, *grid)``.
        t: one time for all states, or the time of each, ``(time,)``.
    """
    own = [Term(field, expr) for field, expr in system.equations.items()]
    found = [_mean_squares(system, own, *part) for part in in_blocks(states, t, len(own))]
    count, squares = sum(known for known, _ in found), torch.zeros(len(own)).double()
    for known, means in found:
        if known:
            squares += known / count * means
    size = squares.sqrt().nan_to_num(nan=0.0)
    return torch.where(size > LEAST, size, _size_at_rest(states, t)).clamp(min=LEAST)


def _size_at_rest(states: Tensor, t: float | Tensor) -> Tensor:
    """Return the rms of every field over the time that passes, ``(field,)``; 0 at one time."""
    span = float(t.max() - t.min()) if isinstance(t, Tensor) and t.numel() else 0.0
    rms = states.transpose(0, 1).flatten(1).square().mean(dim=1).sqrt().nan_to_num(nan=0.0)
    return rms / span if span > 0 else torch.zeros_like(rms)


def _mean_squares(
    system: System, own: Sequence[Term], states: Tensor, t: float | Tensor
) -> tuple[int, Tensor]:
    """Return the number of states that count, and the mean square of each rate over them."""
    rates = evaluate_terms(system, own, states, t).transpose(0, 1)
    if system.program is not None:
        rates = rates + program_rates(system, states, t)
        # A program may fail at some states.
        rates = rates[torch.isfinite(rates).flatten(1).all(dim=1)]
    return len(rates), rates.transpose(0, 1).flatten(1).square().mean(dim=1)


@torch.no_grad()
def program_rates(system: System, states: Tensor, t: float | Tensor) -> Tensor:
    """Return the rate of change by a program, ``(batch, field, *grid)``, from a short step.

    Args:
        system: with a program.
        states: ``(batch, field, *grid)``.
        t: one time for all states, or the time of each, ``(batch,)``.
    """
    h = SHORT_STEP * system.dt
    ends = _program_step(system, states, t, h, system.config.parameters)
    return torch.from_numpy((ends - states.double().numpy()) / h)


@torch.no_grad()
def program_slopes(
    system: System, states: Tensor, t: float | Tensor, names: Sequence[str]
) -> Tensor:
    """Return the derivatives of a program's rate by parameters, ``(name, batch, field, *grid)``.

    They are extrapolated to a step of length zero, in which no effect has passed to other fields.
    This takes two steps from each state, and two more for each parameter.

    Args:
        system: with a program.
        states: ``(batch, field, *grid)``.
        t: one time for all states, or the time of each, ``(batch,)``.
        names: of the parameters.
    """
    assert system.program is not None
    known = system.config.parameters
    found = []
    for h in (SHORT_STEP * system.dt, SHORT_STEP * system.dt / 2):
        step = partial(_program_step, system, states, t, h)
        after = step(known)
        found.append(parameter_slopes(step, after, known, names, system.program.rounding) / h)
    return torch.from_numpy(2 * found[1] - found[0])


def _program_step(
    system: System, states: Tensor, t: float | Tensor, h: float, parameters: Mapping[str, float]
) -> Array:
    """Return the states after a step of the program, ``(batch, field, *grid)``."""
    assert system.program is not None
    times = np.broadcast_to(np.asarray(t, dtype=np.float64), len(states)).copy()
    steps = np.full(len(states), h)
    inputs = ProgramFlow(system).inputs(times, steps)
    return system.program.step(states.double().numpy(), times, steps, inputs, parameters)
