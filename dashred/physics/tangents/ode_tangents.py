"""Tangents of an ODE system: derivatives of a trajectory by initial state, terms and forcing."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import lru_cache

import numpy as np
import torch
from torch import Tensor

from dashred.physics.backends.stack_program import NamePlaces, build_programs, stack_depth
from dashred.physics.expressions.algebra import ZERO, Expr
from dashred.physics.expressions.differentiate import NotDifferentiableError, differentiate
from dashred.physics.forcing_basis import ForcingBasis, SampledForcing
from dashred.physics.solvers.forcing import Forcing
from dashred.physics.solvers.schedule import Step, schedule
from dashred.physics.system import System, Term
from dashred.physics.tangents.ode_columns import (
    Array,
    KnotForcing,
    LinearizedRates,
    integrate_columns,
)


def has_ode_tangents(system: System, terms: Sequence[Term]) -> bool:
    """Return whether :func:`tangent_ode` supports these equations and terms.

    Args:
        system: any system.
        terms: terms of the forcing, with lets and parameters resolved. Sources may be any terms.
    """
    if system.axes or system.tableau is None:
        return False
    try:
        for expr in (*system.resolved.values(), *(term.expression for term in terms)):
            _slopes(expr, system.fields)
    except (NotDifferentiableError, ArithmeticError):
        return False
    return True


@torch.no_grad()
def tangent_ode(
    system: System,
    start: Tensor,
    directions: Tensor,
    times: Tensor,
    forcing: Forcing | None,
    sources: Sequence[tuple[Term, ...]],
    sampled_forcing: SampledForcing | None = None,
    forcing_basis: ForcingBasis | None = None,
) -> Iterator[tuple[Tensor, Tensor]]:
    """Yield state and tangents at every output time: ``δ' = N'(u) δ + s(u, t)``.

    The counterpart of :func:`dashred.physics.tangents.tangent_linear.tangent_linear` for systems
    without axes.

    Args:
        system: a system for which :func:`has_ode_tangents` is true.
        start: ``(field,)`` at ``times[0]``, float64.
        directions: ``∂u(0)/∂z``, ``(direction, field)``.
        times: output times ``(time,)``.
        forcing: one row of additional terms, part of the reference trajectory and of N'.
        sources: column k is ``∂u(t)/∂ξ`` for ``∂u/∂t = … + ξ Σ_{θ in sources[k]} θ(u)`` at 0.
        sampled_forcing: free forcing of the reference trajectory, one row.
        forcing_basis: basis of a free forcing; one column ``∂u(t)/∂a`` for each coefficient a.

    Yields:
        The state ``(field,)`` and the tangents ``(column, field)``, float64: directions first,
        then sources, then basis functions.
    """
    steps = list(schedule(times.tolist(), system.dt, system.jumps))
    integrator = OdeColumns(
        system, forcing, sources, len(directions), sampled_forcing, forcing_basis
    )
    columns = np.zeros((integrator.count, len(system.fields)))
    columns[: len(directions)] = directions.double().numpy()
    found = integrator.advance(start.numpy(), columns, steps)
    yield from zip(*map(torch.from_numpy, found), strict=True)


class OdeColumns:
    """Integrates one trajectory of an ODE system with its tangents.

    Attributes:
        count: number of columns.

    Args:
        system: a system for which :func:`has_ode_tangents` is true.
        forcing: as in :func:`tangent_ode`, and so are the others.
        sources: terms of further columns.
        directions: number of columns of the start.
        sampled_forcing: free forcing, one row.
        forcing_basis: basis of a free forcing.
    """

    def __init__(
        self,
        system: System,
        forcing: Forcing | None,
        sources: Sequence[tuple[Term, ...]],
        directions: int,
        sampled_forcing: SampledForcing | None = None,
        forcing_basis: ForcingBasis | None = None,
    ) -> None:
        tableau = system.tableau
        assert tableau is not None
        first = directions + len(sources)
        self._free = _knot_forcing(sampled_forcing, forcing_basis, first)
        self._rates = _linearized_rates(system, forcing, sources, directions)
        self._tableau = tableau
        self.count = first + self._free.basis.shape[1] * len(system.fields)

    def advance(self, start: Array, columns: Array, steps: Sequence[Step]) -> tuple[Array, Array]:
        """Return states ``(time, field)`` and columns ``(time, column, field)``.

        The first are those of the start, the others those at the end of every interval.

        Args:
            start: ``(field,)``.
            columns: ``(column, field)``.
            steps: of the integration.
        """
        outputs = 1 + sum(step.ends for step in steps)
        states, whole = np.empty((outputs, *start.shape)), np.empty((outputs, *columns.shape))
        states[0], whole[0] = start, columns
        integrate_columns(
            self._rates,
            self._free,
            np.array([step.t for step in steps], dtype=np.float64),
            np.array([step.h for step in steps], dtype=np.float64),
            np.array([step.ends for step in steps], dtype=np.bool_),
            np.array(self._tableau.square),
            np.array(self._tableau.b),
            np.array(self._tableau.c),
            states,
            whole,
        )
        return states, whole


@lru_cache(maxsize=4096)
def _slopes(expr: Expr, fields: tuple[str, ...]) -> tuple[Expr, ...]:
    """Return the derivative by each field."""
    return tuple(differentiate(expr, field) for field in fields)


def _linearized_rates(
    system: System, forcing: Forcing | None, sources: Sequence[tuple[Term, ...]], first: int
) -> LinearizedRates:
    """Return the rates of change of one trajectory; ``first`` is the column of the first source."""
    channel = {field: i for i, field in enumerate(system.fields)}
    functions = [(channel[field], expr) for field, expr in system.resolved.items()]
    weights = [1.0] * len(functions)
    if forcing is not None:
        functions += [(channel[term.equation], term.expression) for term in forcing.terms]
        weights += forcing.coefficients[0].tolist()
    slopes = [
        (k, i, slope)
        for k, (_, expr) in enumerate(functions)
        for i, slope in enumerate(_slopes(expr, system.fields))
        if slope != ZERO
    ]
    added = [
        (first + column, channel[term.equation], term.expression)
        for column, terms in enumerate(sources)
        for term in terms
    ]
    signals = system.input_signals
    names = [*system.fields, "t", *signals.values]
    places = NamePlaces({name: j for j, name in enumerate(names)}, {})
    expressions = [expr for _, expr in functions]
    expressions += [expr for *_, expr in (*slopes, *added)]
    programs = build_programs([(expr, places) for expr in expressions])
    return LinearizedRates(
        programs,
        np.array([field for field, _ in functions], dtype=np.int64),
        np.array(weights),
        np.array([slope[:2] for slope in slopes], dtype=np.int64).reshape(-1, 2),
        np.array([source[:2] for source in added], dtype=np.int64).reshape(-1, 2),
        np.ascontiguousarray(signals.table),
        stack_depth(programs),
    )


def _knot_forcing(
    sampled_forcing: SampledForcing | None, forcing_basis: ForcingBasis | None, first: int
) -> KnotForcing:
    """Return the free forcing of one trajectory and the basis of its columns from ``first`` on."""
    knots, values = np.empty(0), np.empty((0, 0))
    basis_knots, basis = np.empty(0), np.empty((0, 0))
    if sampled_forcing is not None:
        knots, [values] = sampled_forcing.knots.numpy(), sampled_forcing.values.numpy()
    if forcing_basis is not None:
        basis_knots = forcing_basis.knots.numpy()
        # An ODE has one cell of height b: the courses of the columns are b times those in time.
        basis = np.kron(forcing_basis.bumps.numpy().reshape(1, -1), forcing_basis.courses.numpy())
    own, added = np.ascontiguousarray(values), np.ascontiguousarray(basis)
    return KnotForcing(knots, own, basis_knots, added, first)
