"""The derivative of one step times columns: by differences, or by tangents of a program."""

from __future__ import annotations

import torch
from torch import Tensor

from dashred.physics.solvers.splitting import Flow, ProgramFlow

# The smallest change in a difference.
SMALLEST = 1e-100


def carry(
    flow: Flow, state: Tensor, columns: Tensor, t: float, h: float, small: Tensor
) -> tuple[Tensor, Tensor]:
    """Return the state after a step, and ``P'(u)`` times the columns.

    Args:
        flow: P.
        state: u, ``(field, *grid)``.
        columns: ``(column, field, *grid)``.
        t: time.
        h: step.
        small: largest change of each field in a difference, ``(field,)``.
    """
    if state.numel() < len(columns):
        unit = torch.eye(state.numel(), dtype=torch.float64).reshape(-1, *state.shape)
        after, slopes = carry(flow, state, unit, t, h, small)
        moved = columns.flatten(1) @ slopes.flatten(1)
        return after, moved.reshape(columns.shape)
    limit = small.clamp(min=SMALLEST).reshape(-1, *(1,) * (state.dim() - 1))
    size = (columns / limit).flatten(1).abs().amax(dim=1)
    # A column of zeros stays zero.
    alive = torch.nonzero(size > 0)[:, 0]
    scaled = size[alive].reshape(-1, *(1,) * state.dim())
    ends = flow(torch.cat([state[None], state + columns[alive] / scaled]), t, h)
    moved = torch.zeros_like(columns)
    moved[alive] = (ends[1:] - ends[0]) * scaled
    return ends[0], moved


def push(
    flow: ProgramFlow, state: Tensor, columns: Tensor, t: float, h: float
) -> tuple[Tensor, Tensor]:
    """Return what :func:`carry` does, with the tangents that the program offers."""
    if state.numel() < len(columns):
        unit = torch.eye(state.numel(), dtype=torch.float64).reshape(-1, *state.shape)
        after, slopes = push(flow, state, unit, t, h)
        return after, (columns.flatten(1) @ slopes.flatten(1)).reshape(columns.shape)
    alive = torch.nonzero(columns.flatten(1).any(dim=1))[:, 0]
    if not len(alive):
        return flow(state[None], t, h)[0], columns
    moved = torch.zeros_like(columns)
    after, moved[alive] = flow.push(state, columns[alive], t, h)
    return after, moved
