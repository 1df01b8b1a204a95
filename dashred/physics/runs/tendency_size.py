"""Size of the right-hand side of every equation along a trajectory."""

from __future__ import annotations

import numpy as np
import torch
from torch import Tensor

from dashred.physics.library import evaluate_terms
from dashred.physics.system import System, Term

# A difference in time over this share of the time step is the rate of a program.
SHORT_STEP = 1 / 16
# Smallest rms of a tendency: a simulation may stay at rest.
LEAST = 1e-12


def tendency_size(system: System, states: Tensor, t: float | Tensor) -> Tensor:
    """Return the rms of the right-hand side of each equation over a simulation, ``(field,)``.

    It is positive even if the simulation stays at rest. States that a program cannot step do not
    count.

    Args:
        system: the simulator.
        states: ``(time, field, *grid)``.
        t: one time for all states, or the time of each, ``(time,)``.
    """
    own = [Term(field, expr) for field, expr in system.equations.items()]
    rates = evaluate_terms(system, own, states, t).transpose(0, 1)
    if system.program is not None:
        rates = rates + program_rates(system, states, t)
        # A program may fail at some states.
        rates = rates[torch.isfinite(rates).flatten(1).all(dim=1)]
    rms = rates.transpose(0, 1).flatten(1).square().mean(dim=1).sqrt()
    return rms.nan_to_num(nan=0.0).clamp(min=LEAST)


@torch.no_grad()
def program_rates(system: System, states: Tensor, t: float | Tensor) -> Tensor:
    """Return the rate of change by a program, ``(batch, field, *grid)``, from a short step.

    Args:
        system: with a program.
        states: ``(batch, field, *grid)``.
        t: one time for all states, or the time of each, ``(batch,)``.
    """
    assert system.program is not None
    times = np.broadcast_to(np.asarray(t, dtype=np.float64), len(states)).copy()
    steps = np.full(len(states), SHORT_STEP * system.dt)
    signals = system.input_signals.at(times + steps / 2)
    inputs = {name: np.broadcast_to(value, times.shape).copy() for name, value in signals.items()}
    begin = states.double().numpy()
    ends = system.program.step(begin, times, steps, inputs, system.config.parameters)
    return torch.from_numpy((ends - begin) / steps[0])
