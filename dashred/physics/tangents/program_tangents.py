"""Derivatives of the trajectory of a program by its start, the added terms and a free forcing.

The equations of a program are not known. The columns are carried along the split steps
(:mod:`dashred.physics.solvers.splitting`) by one-sided differences, renewed at every step::

    P'(u) δ ≈ (P(u + ε δ) - P(u)) / ε

unless the program offers its tangents.

If the state has fewer values than there are columns, the differences are those along its values.
"""

from __future__ import annotations

import copy
from collections.abc import Iterator, Sequence
from typing import Any, Protocol

import numpy as np
import torch
from torch import Tensor

from dashred.physics.backends.torch_backend import Program as Expressions
from dashred.physics.forcing_basis import ForcingBasis, SampledForcing
from dashred.physics.program_parameters import added_terms, changed_parameter
from dashred.physics.solvers.forcing import Forcing
from dashred.physics.solvers.rhs import dealias_mask
from dashred.physics.solvers.schedule import Step, schedule
from dashred.physics.solvers.splitting import AddedFlow, Flow, ProgramFlow, split_steps
from dashred.physics.system import System, Term
from dashred.physics.tangents.ode_tangents import OdeColumns
from dashred.physics.tangents.semilinear_rhs import with_terms

# Rounding error of the added flow, and the smallest change in a difference.
ROUNDING, SMALLEST = 1e-16, 1e-100


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
    added: HalfStep = _GridColumns(system, *parts) if system.axes else _OdeColumns(system, *parts)
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


def _with_law(system: System, forcing: Forcing | None) -> System:
    """Return the system with the terms of a forcing of one row in its equations, for any batch."""
    changed = copy.copy(system)
    if forcing is not None:
        [coefficients] = forcing.coefficients.tolist()
        changed.resolved = with_terms(system, forcing.terms, coefficients)
    return changed


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


class _GridColumns:
    """The half step of fields: differences of the flow, and half of the sources at both ends.

    Without a flow, all of them are in the middle.

    Args:
        system: with a program.
        forcing: as in :func:`tangent_program`, and so are the others.
        sources: terms of further columns.
        first: index of the first of these columns.
        sampled_forcing: free forcing, one row.
        forcing_basis: basis of a free forcing.
    """

    def __init__(
        self,
        system: System,
        forcing: Forcing | None,
        sources: Sequence[tuple[Term, ...]],
        first: int,
        sampled_forcing: SampledForcing | None,
        forcing_basis: ForcingBasis | None,
    ) -> None:
        self.system, self.basis = system, forcing_basis
        self.flow = AddedFlow(_with_law(system, forcing), None, sampled_forcing)
        self.first, self.terms = first, len(sources)
        self.count = first + self.terms + (0 if forcing_basis is None else forcing_basis.count)
        self.places = [
            (k, system.fields.index(term.equation))
            for k, terms in enumerate(sources)
            for term in terms
        ]
        self.values = Expressions([term.expression for terms in sources for term in terms])
        dealias = system.spectral and system.config.integrator.dealias
        self.mask = dealias_mask(system) if dealias else None
        if forcing_basis is not None:
            self.bumps = self._dealiased(forcing_basis.bumps)

    def __call__(
        self, state: Tensor, columns: Tensor, t: float, h: float, reach: Tensor
    ) -> tuple[Tensor, Tensor]:
        """See :class:`HalfStep`."""
        columns = columns.clone()
        if self.flow.is_empty:
            self._add_sources(columns, h, state, t + h / 2)
            return state, columns
        self._add_sources(columns, h / 2, state, t)
        if self.flow.is_forcing_alone:
            after = self.flow(state[None], t, h)[0]
        else:
            after, columns = carry(self.flow, state, columns, t, h, ROUNDING**0.5 * reach)
        self._add_sources(columns, h / 2, after, t + h)
        return after, columns

    def _add_sources(self, columns: Tensor, h: float, state: Tensor, t: float) -> None:
        """Add h times the sources at a state ``(field, *grid)`` to the columns."""
        if self.places:
            columns[self.first : self.first + self.terms] += h * self._of_terms(state, t)
        if self.basis is not None:
            # A view (field, cell, course, field, *grid): a basis function acts on its own field.
            fields, cells, courses = self.basis.shape
            parts = fields, cells, courses, *state.shape
            own = columns[self.first + self.terms :].view(parts)
            [hats] = self.basis.hats(np.array([t]))
            for course in np.flatnonzero(hats):
                for field in range(fields):
                    own[field, :, course, field] += h * float(hats[course]) * self.bumps

    def _of_terms(self, state: Tensor, t: float) -> Tensor:
        """Return the sources of the terms, ``(column, field, *grid)``."""
        system, shape = self.system, self.system.grid.shape
        found = torch.zeros((self.terms, *state.shape), dtype=torch.float64)
        values = self.values(system.values(self._dealiased(state[None]), t), system.operators)
        for (column, field), value in zip(self.places, values, strict=True):
            points = torch.as_tensor(system.operators.on_grid(value), dtype=torch.float64)
            found[column, field] += points.expand(1, *shape)[0]
        return self._dealiased(found)

    def _dealiased(self, states: Tensor) -> Tensor:
        """Return states ``(batch, field, *grid)`` without the highest modes, as for the law."""
        if self.mask is None:
            return states
        dims, shape = self.system.grid.dims, self.system.grid.shape
        return torch.fft.irfftn(torch.fft.rfftn(states, dim=dims) * self.mask, s=shape, dim=dims)
