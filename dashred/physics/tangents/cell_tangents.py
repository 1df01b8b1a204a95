"""Tangents of finite volumes: derivatives of a trajectory by initial state, terms and forcing.

The trajectory is integrated in blocks of steps. The Jacobians and sources are evaluated at all
stages of a block at once, and the tangents follow with the same exponential steps. They obey the
homogeneous form of the conditions at the ends; a change of a condition is a source.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import cache
from itertools import islice

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from dashred.physics.backends.torch_backend import Program
from dashred.physics.cells.exponential import StepMatrices, step_matrices
from dashred.physics.cells.integrate import CellStepper, Reference
from dashred.physics.cells.linear_part import linear_part
from dashred.physics.expressions.algebra import Expr
from dashred.physics.expressions.semilinear import NotSemilinearError
from dashred.physics.forcing_basis import ForcingBasis, SampledForcing
from dashred.physics.solvers.forcing import Forcing
from dashred.physics.solvers.rhs import GridTendency
from dashred.physics.solvers.schedule import schedule
from dashred.physics.system import System, Term
from dashred.physics.tangents.cell_slopes import CellJacobian
from dashred.physics.tangents.reference_trajectory import stage_times
from dashred.physics.tangents.semilinear_rhs import with_terms

Array = NDArray[np.float64]

# Steps whose Jacobians and sources are in memory together.
STEPS_AT_ONCE = 64
STAGES = 4


def has_cell_tangents(system: System, terms: Sequence[Term]) -> bool:
    """Return whether :func:`tangent_cells` supports these equations and terms.

    Args:
        system: any system.
        terms: terms of the forcing, with lets and parameters resolved. Sources may be any terms.
    """
    if not system.has_conditions:
        return False
    try:
        CellJacobian(system, with_terms(system, terms, [1.0] * len(terms)))
    except (NotSemilinearError, ArithmeticError):
        return False
    return True


@torch.no_grad()
def tangent_cells(
    system: System,
    start: Tensor,
    directions: Tensor,
    times: Tensor,
    forcing: Forcing | None,
    sources: Sequence[tuple[Term, ...]],
    sampled_forcing: SampledForcing | None = None,
    forcing_basis: ForcingBasis | None = None,
    reference: Reference | None = None,
) -> Iterator[tuple[Tensor, Tensor]]:
    """Yield state and tangents at every output time: ``δ' = N'(u) δ + s(u, t)``.

    The counterpart of :func:`dashred.physics.tangents.tangent_linear.tangent_linear` for an axis
    with a condition for each side.

    Args:
        system: a system for which :func:`has_cell_tangents` is true.
        start: ``(field, point)`` at ``times[0]``, float64.
        directions: ``∂u(0)/∂z``, ``(direction, field, point)``.
        times: output times ``(time,)``.
        forcing: one row of additional terms, part of the reference trajectory and of N'.
        sources: column k is ``∂u(t)/∂ξ`` for ``∂u/∂t = … + ξ Σ_{θ in sources[k]} θ(u)`` at 0.
        sampled_forcing: free forcing of the reference trajectory, one row.
        forcing_basis: basis of a free forcing; one column ``∂u(t)/∂a`` for each coefficient a.
        reference: integrates the reference trajectory with these forcings; by default without
            compilation.

    Yields:
        The state ``(field, point)`` and the tangents ``(column, field, point)``, float64:
        directions first, then sources, then basis functions.
    """
    extension = system.extension
    added = ([], []) if forcing is None else (forcing.terms, forcing.coefficients[0].tolist())
    jacobian = CellJacobian(system, with_terms(system, *added))
    drive = _Sources(system, sources, forcing_basis)
    if reference is None:
        tendency = GridTendency(system, forcing, sampled_forcing)
        reference = CellStepper(system, tendency).reference
    linear = linear_part(system)
    cells = extension.cells(start[None])
    shape = cells.shape
    tangents = np.zeros((jacobian.size, len(directions) + drive.count))
    tangents[:, : len(directions)] = extension.cells(directions.double()).flatten(1).T.numpy()
    begin = float(times[0])
    yield _whole(system, cells, begin), _columns(system, tangents)
    state, steps = cells.flatten().numpy(), schedule(times.tolist(), system.dt, system.jumps)
    matrices = cache(lambda h: step_matrices(linear, h))
    while block := list(islice(steps, STEPS_AT_ONCE)):
        stages = reference(block, state)
        state = stages[-1, -1]
        # A blow-up shows as non-finite values, not as a warning.
        with np.errstate(all="ignore"):
            moments = stage_times(block)
            inner = torch.from_numpy(stages[:, :STAGES].copy()).reshape(-1, *shape[1:])
            whole = extension.homogeneous(inner) + torch.from_numpy(extension.given(moments))
            slopes = jacobian(whole.numpy(), moments) - linear
            driven = drive(whole, moments, len(directions))
            for k, step in enumerate(block):
                at = slice(STAGES * k, STAGES * (k + 1))
                tangents = _advance(matrices(step.h), tangents, slopes[at], driven[at])
                if step.ends:
                    end = torch.from_numpy(stages[k, STAGES].copy()).reshape(shape)
                    yield _whole(system, end, step.t + step.h), _columns(system, tangents)


def _advance(step: StepMatrices, tangents: Array, slopes: Array, driven: Array) -> Array:
    """Return the tangents ``(n, column)`` after a step.

    Args:
        step: matrices of the step.
        tangents: before it.
        slopes: N' - A at the four stages, ``(4, n, n)``.
        driven: sources at the four stages, ``(4, n, column)``.
    """
    n = slopes[0] @ tangents + driven[0]
    damped = step.half @ tangents
    a = damped + step.stage @ n
    n_a = slopes[1] @ a + driven[1]
    b = damped + step.stage @ n_a
    n_b = slopes[2] @ b + driven[2]
    c = step.half @ a + step.stage @ (2 * n_b - n)
    n_c = slopes[3] @ c + driven[3]
    end = step.full @ tangents + step.first @ n + step.middle @ (n_a + n_b) + step.last @ n_c
    found: Array = end
    return found


class _Sources:
    """Sources of the columns at the cells: terms along a trajectory, and a basis of a forcing."""

    def __init__(
        self,
        system: System,
        sources: Sequence[tuple[Term, ...]],
        forcing_basis: ForcingBasis | None,
    ) -> None:
        self._system, self._basis = system, forcing_basis
        self._owned = len(sources)
        self.count = self._owned + (0 if forcing_basis is None else forcing_basis.count)
        rows: dict[Expr, int] = {}
        self._places = [
            (rows.setdefault(term.expression, len(rows)), system.fields.index(term.equation), k)
            for k, terms in enumerate(sources)
            for term in terms
        ]
        self._program = Program(list(rows))

    def __call__(self, states: Tensor, t: Array, before: int) -> Array:
        """Return the sources ``(state, n, before + column)``; the first columns have none."""
        system = self._system
        values = system.values(states, t[:, None])
        cells = system.extension.cells(states)
        found = np.zeros((*cells.shape, before + self.count))
        rows = [
            torch.as_tensor(system.operators.on_grid(value), dtype=torch.float64)
            .expand(states[:, 0].shape)[:, 1::2]
            .numpy()
            for value in self._program(values, system.operators)
        ]
        for row, field, column in self._places:
            found[:, field, :, before + column] += rows[row]
        if self._basis is not None:
            fields, bumps, courses = self._basis.shape
            hats = self._basis.hats(t)
            own = np.einsum("sk,bc->scbk", hats, self._basis.bumps[:, 1::2].numpy())
            first, each = before + self._owned, bumps * courses
            for field in range(fields):
                columns = slice(first + field * each, first + (field + 1) * each)
                found[:, field, :, columns] += own.reshape(*own.shape[:2], each)
        return found.reshape(len(states), -1, before + self.count)


def _whole(system: System, cells: Tensor, t: float) -> Tensor:
    return system.extension.whole(cells, t)[0]


def _columns(system: System, tangents: Array) -> Tensor:
    """Return tangents ``(n, column)`` at all points, ``(column, field, point)``."""
    cells = torch.from_numpy(tangents.T.reshape(tangents.shape[1], len(system.fields), -1).copy())
    return system.extension.homogeneous(cells)
