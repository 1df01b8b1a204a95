"""Equations of a program that only define another field, such as ``θ' = ω``.

They are recognised by the rates of change along a simulation, because a program has no expressions.
"""

from __future__ import annotations

import torch
from torch import Tensor

from dashred.physics.runs.tendency_size import program_rates
from dashred.physics.system import System

# Allowed deviation of a rate from a multiple of another field, as a share of its rms. A rate comes
# from a difference over a short time, during which the other field changes.
TOLERANCE = 0.02
# A field is moved by this share of its rms to see what it acts on.
MOVE = 0.1
# States that are compared.
MOST_STATES = 64


def program_definitions(system: System, states: Tensor, times: Tensor) -> dict[str, str]:
    """Return the fields whose rate is another field times a positive number, with that field.

    None if all equations are of this kind; see :func:`.library.equations_with_candidates`.

    Args:
        system: with a program.
        states: of a simulation, ``(time, field, *grid)``.
        times: ``(time,)``.
    """
    stride = -(-len(states) // MOST_STATES)
    states, times = states[::stride], times[::stride]
    rates = program_rates(system, states, times)
    found: dict[str, str] = {}
    for i, field in enumerate(system.fields):
        size = rates[:, i].norm()
        for j, other in enumerate(system.fields):
            product, square = (rates[:, i] * states[:, j]).sum(), states[:, j].square().sum()
            if i == j or not product > 0:
                continue
            factor = float(product / square)
            rest = rates[:, i] - factor * states[:, j]
            if float(torch.linalg.vector_norm(rest)) >= TOLERANCE * float(size):
                continue
            if abs(factor - 1) < TOLERANCE or _acts_on(system, states, times, rates, i, j):
                found[field] = other
    return found if len(found) < len(system.fields) else {}


def _acts_on(
    system: System, states: Tensor, times: Tensor, rates: Tensor, field: int, other: int
) -> bool:
    """Tell whether the rate of another field depends on a field."""
    moved = states.clone()
    moved[:, field] += MOVE * states[:, field].square().mean().sqrt()
    change = program_rates(system, moved, times)[:, other] - rates[:, other]
    return float(change.norm()) > TOLERANCE * MOVE * float(rates[:, other].norm())
