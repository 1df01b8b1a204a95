"""Derivatives of the trajectory of a program by its start, the added terms and a free forcing.

The equations of a program are not known. The columns are carried along the split steps
(:mod:`dashred.physics.solvers.splitting`) by one-sided differences, renewed at every step::

    P'(u) δ ≈ (P(u + ε δ) - P(u)) / ε

unless the program offers its tangents.

If the state has fewer values than there are columns, the differences are those along its values.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any, Protocol

import torch
from torch import Tensor

from dashred.physics.forcing_basis import ForcingBasis, SampledForcing
from dashred.physics.program_parameters import added_terms, changed_parameter
from dashred.physics.solvers.forcing import Forcing
from dashred.physics.solvers.schedule import Step, schedule
from dashred.physics.solvers.splitting import ProgramFlow, split_steps
from dashred.physics.system import System, Term
from dashred.physics.tangents.grid_columns import GridColumns
from dashred.physics.tangents.ode_tangents import OdeColumns
from dashred.physics.tangents.step_tangents import carry, push


@torch.no_grad()
def tangent_program(
    system: System,
    start: Tensor,
    directions: Tensor,
    times: Tensor,
    forcing: Forcing | None,
    sources: Sequence[tuple[Term, ...]],
    sampled_forcing: SampledForcing | None = None,
    forcing_basis: ForcingBasis | None = None,
) -> Iterator[tuple[Tensor, Tensor]]:
    """Yield state and tangents at every output time.

    The counterpart of :func:`dashred.physics.tangents.tangent_linear.tangent_linear` for programs.

    Args:
        system: with a program.
        start: ``(field, *grid)`` at ``times[0]``, float64.
        directions: ``∂u(0)/∂z``, ``(direction, field, *grid)``.
        times: output times ``(time,)``.
        forcing: one row of additional terms, part of the reference trajectory.
        sources: column k is ``∂u(t)/∂ξ`` for ``∂u/∂t = … + ξ Σ_{θ in sources[k]} θ(u)`` at 0.
        sampled_forcing: free forcing of the reference trajectory, one row.
        forcing_basis: basis of a free forcing; one column ``∂u(t)/∂a`` for each coefficient a.

    Yields:
        The state ``(field, *grid)`` and the tangents ``(column, field, *grid)``, float64:
        directions first, then sources, then basis functions.
    """
    changes = None if forcing is None else forcing.parameter_changes()
    flow, first = ProgramFlow(system, changes), len(directions)
    # The columns of the program's own parameters.
    changed = [(first + k, changed_parameter(t)) for k, terms in enumerate(sources) for t in terms]
    moved = {k: name for k, name in changed if name is not None}
    added_sources = [added_terms(terms) for terms in sources]
    parts = forcing and forcing.added(), added_sources, first, sampled_forcing, forcing_basis
    added: HalfStep = GridColumns(system, *parts) if system.axes else _OdeColumns(system, *parts)
    columns = torch.zeros((added.count, *start.shape), dtype=torch.float64)
    columns[:first] = directions
    state, reach = start, torch.cat([start[None], directions]).abs()
    # The largest size of each field so far: a field that crosses zero is no small field.
    reach = reach.reshape(*reach.shape[:2], -1).amax(dim=(0, 2))
    yield state, columns
    for step in split_steps(schedule(times.tolist(), system.dt, system.jumps)):
        state, columns = added(state, columns, *step.before, reach)
        reach = torch.maximum(reach, state.abs().reshape(len(state), -1).amax(dim=1))
        small = flow.program.rounding**0.5 * reach
        before = state
        if flow.program.tangent is None:
            state, columns = carry(flow, state, columns, step.t, step.h, small)
        else:
            state, columns = push(flow, state, columns, step.t, step.h)
        if moved:
            columns[[*moved]] += flow.slopes(before, state, step.t, step.h, [*moved.values()])
        if step.after is not None:
            state, columns = added(state, columns, *step.after, reach)
            yield state, columns


class HalfStep(Protocol):
    """Advances a state and its columns by the added terms.

    Attributes:
        count: number of columns.
    """

    count: int

    def __call__(
        self, state: Tensor, columns: Tensor, t: float, h: float, reach: Tensor
    ) -> tuple[Tensor, Tensor]:
        """Return the state ``(field, *grid)`` and the columns ``(column, field, *grid)``.

        Args:
            state: at t, ``(field, *grid)``.
            columns: ``(column, field, *grid)``.
            t: time.
            h: step.
            reach: size of each field, ``(field,)``.
        """


class _OdeColumns:
    """The half step of a system without axes, in compiled code."""

    def __init__(self, system: System, *parts: Any) -> None:
        self.columns = OdeColumns(system, *parts)
        self.count = self.columns.count

    def __call__(
        self, state: Tensor, columns: Tensor, t: float, h: float, reach: Tensor
    ) -> tuple[Tensor, Tensor]:
        """See :class:`HalfStep`."""
        whole = Step(t, h, begins=True, ends=True, first=t, last=t + h)
        states, moved = self.columns.advance(state.numpy(), columns.numpy(), [whole])
        return torch.from_numpy(states[1]), torch.from_numpy(moved[1])
