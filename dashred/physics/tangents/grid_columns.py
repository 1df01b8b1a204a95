"""Derivatives of the trajectory of a program on a grid: what the added terms do to the columns."""

from __future__ import annotations

import copy
from collections.abc import Sequence

import numpy as np
import torch
from torch import Tensor

from dashred.physics.backends.torch_backend import Program as Expressions
from dashred.physics.forcing_basis import ForcingBasis, SampledForcing
from dashred.physics.grids.transforms import modes_of, points_of
from dashred.physics.solvers.forcing import Forcing
from dashred.physics.solvers.rhs import dealias_mask
from dashred.physics.solvers.splitting import AddedFlow
from dashred.physics.system import System, Term
from dashred.physics.tangents.semilinear_rhs import with_terms
from dashred.physics.tangents.step_tangents import carry

# Rounding error of the added flow.
ROUNDING = 1e-16


class GridColumns:
    """The half step of fields: differences of the flow, and half of the sources at both ends.

    Without a flow, all of them are in the middle.

    Args:
        system: with a program.
        forcing: as in :func:`.program_tangents.tangent_program`, and so are the others.
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
        """See :class:`.program_tangents.HalfStep`."""
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
        shape = self.system.grid.shape
        return points_of(modes_of(states, shape) * self.mask, shape)


def _with_law(system: System, forcing: Forcing | None) -> System:
    """Return the system with the terms of a forcing of one row in its equations, for any batch."""
    changed = copy.copy(system)
    if forcing is not None:
        [coefficients] = forcing.coefficients.tolist()
        changed.resolved = with_terms(system, forcing.terms, coefficients)
    return changed
