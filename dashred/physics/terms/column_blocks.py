"""Columns of many states, of which only so many are in memory as fit."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence

import torch
from torch import Tensor

from dashred.physics.system import System, Term
from dashred.physics.terms.library import evaluate_terms

# Bytes of the columns that are in memory together.
COLUMN_BYTES = 2**29


def in_blocks(
    states: Tensor, t: float | Tensor, terms: int
) -> Iterator[tuple[Tensor, float | Tensor]]:
    """Yield states with their times, so few that their columns fit into memory; mostly all.

    Args:
        states: ``(batch, field, *grid)``.
        t: one time for all states, or the time of each, ``(batch,)``.
        terms: number of columns.
    """
    points = math.prod(states.shape[2:])
    length = max(1, COLUMN_BYTES // (8 * max(1, terms) * points))
    for first in range(0, len(states), length):
        own = slice(first, first + length)
        yield states[own], t[own] if isinstance(t, Tensor) else t


def rms_of_columns(
    system: System, library: Sequence[Term], states: Tensor, t: float | Tensor
) -> Tensor:
    """Return ``rms(θ_j)`` over states and grid, ``(term,)``; arguments as in :func:`in_blocks`."""
    squares = torch.zeros(len(library), dtype=torch.float64)
    for part, times in in_blocks(states, t, len(library)):
        share = len(part) / len(states)
        squares += share * evaluate_terms(system, library, part, times).flatten(1).pow(2).mean(1)
    return squares.sqrt()
