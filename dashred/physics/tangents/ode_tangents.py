"""Tangents of an ODE system: what small changes of start and forcing do, beside the trajectory.

A system without axes has few unknowns and short steps: the trajectory is marched first, then its
slopes and all sources are evaluated at every stage at once, and the columns are marched with them.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

import numpy as np
import torch
from torch import Tensor

from dashred.physics.backends.numpy_backend import Array, Pointwise
from dashred.physics.expressions.algebra import Expr, add, scale
from dashred.physics.expressions.differentiate import NotDifferentiableError, differentiate
from dashred.physics.forcing_basis import ForcingBasis, SampledForcing
from dashred.physics.runge_kutta import Tableau
from dashred.physics.solvers.forcing import Forcing
from dashred.physics.solvers.schedule import Step, schedule
from dashred.physics.system import System, Term
from dashred.physics.tangents.ode_trajectory import trajectory


def supports_ode(system: System, terms: Sequence[Term]) -> bool:
    """Tell whether :func:`tangent_ode` can carry these equations, with such a forcing.

    Args:
        system: any system.
        terms: what the forcing may hold, lets and parameters resolved. Sources are free.
    """
    if system.axes or system.tableau is None:
        return False
    try:
        for expr in (*system.resolved.values(), *(term.expression for term in terms)):
            _gradient(system, expr)
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

    The same as :func:`dashred.physics.tangents.tangent_linear.tangent_linear`, for systems
    without axes.

    Args:
        system: one that :func:`supports_ode` tells yes of.
        start: ``(field,)`` at ``times[0]``, float64.
        directions: ``∂u(0)/∂z``, ``(direction, field)``.
        times: output times ``(time,)``.
        forcing: one row of further terms, part of the base trajectory and of N'.
        sources: column k is ``∂u(t)/∂ξ`` for ``∂u/∂t = … + ξ Σ_{θ in sources[k]} θ(u)`` at 0.
        sampled_forcing: a free forcing of the base trajectory, of one row.
        forcing_basis: a column for each: ``∂u(t)/∂a``.

    Yields:
        The state ``(field,)`` and the tangents ``(column, field)``, float64: directions first,
        then sources, then pulses.
    """
    assert system.tableau is not None
    tableau, steps = system.tableau, list(schedule(times.tolist(), system.dt))
    # A trajectory that blows up is told by its values.
    with np.errstate(all="ignore"):
        equations = _equations(system, forcing)
        clock = _stage_times(tableau, steps)
        around = _time_and_inputs(system, clock)
        forced = _forcing_at_stages(system, clock, sampled_forcing)
        base = tableau, steps, start.numpy(), system.fields
        stages, states = trajectory(*base, equations, around, forced)
        slopes, source = _jacobians_and_sources(system, stages, around, equations, sources)
        still = np.zeros((*source.shape[:2], *directions.shape))
        pulsed = [] if forcing_basis is None else [_basis_sources(forcing_basis, clock)]
        source = np.concatenate([still, source, *pulsed], axis=2)
        begin = directions.double().numpy()
        found = _integrate_columns(tableau, steps, begin, slopes, source)
    for state, columns in zip(states, found, strict=True):
        yield torch.from_numpy(state), torch.from_numpy(columns)


def _stage_times(tableau: Tableau, steps: Sequence[Step]) -> Array:
    """Return the time of every stage, ``(step, stage)``."""
    return np.array([[step.t + node * step.h for node in tableau.c] for step in steps])


def _equations(system: System, forcing: Forcing | None) -> list[Expr]:
    """Return the right-hand sides with the forcing of one trajectory added."""
    added = {field: [expr] for field, expr in system.resolved.items()}
    if forcing is not None:
        [coefficients] = forcing.coefficients.tolist()
        for term, coefficient in zip(forcing.terms, coefficients, strict=True):
            added[term.equation].append(scale(coefficient, term.expression))
    return [add(added[field]) for field in system.fields]


def _gradient(system: System, expr: Expr) -> list[Expr]:
    return [differentiate(expr, field) for field in system.fields]


def _time_and_inputs(system: System, t: Array) -> dict[str, Array]:
    """Return the time and the inputs."""
    return {"t": t, **system.input_signals.at(t)}


def _forcing_at_stages(
    system: System, clock: Array, sampled_forcing: SampledForcing | None
) -> Array:
    """Return the free forcing at every stage, ``(step, stage, field)``."""
    if sampled_forcing is None:
        return np.zeros((*clock.shape, len(system.fields)))
    [values] = sampled_forcing.values.numpy()
    knots = sampled_forcing.knots.numpy()
    return np.stack([np.interp(clock, knots, along) for along in values.T], axis=-1)


def _jacobians_and_sources(
    system: System,
    stages: Array,
    around: Mapping[str, Array],
    equations: Sequence[Expr],
    sources: Sequence[tuple[Term, ...]],
) -> tuple[Array, Array]:
    """Evaluate N' and the sources at every stage at once.

    Returns:
        ``(step, stage, equation, field)`` and ``(step, stage, column, equation)``.
    """
    fields = len(system.fields)
    slopes = [slope for expr in equations for slope in _gradient(system, expr)]
    rows: dict[tuple[int, int], list[Expr]] = {}
    for column, terms in enumerate(sources):
        for term in terms:
            place = column, system.fields.index(term.equation)
            rows.setdefault(place, []).append(term.expression)
    shape = stages.shape[:2]
    values = {**around, **dict(zip(system.fields, np.moveaxis(stages, -1, 0), strict=True))}
    found = Pointwise([*slopes, *map(add, rows.values())])(values, shape)
    jacobian = np.moveaxis(found[: fields**2], 0, -1).reshape(*shape, fields, fields)
    driven = np.zeros((*shape, len(sources), fields))
    for (column, equation), body in zip(rows, found[fields**2 :], strict=True):
        driven[:, :, column, equation] = body
    return np.ascontiguousarray(jacobian), driven


def _basis_sources(forcing_basis: ForcingBasis, clock: Array) -> Array:
    """Return what every pulse adds to the rates, ``(step, stage, column, equation)``."""
    hats = forcing_basis.hats(clock.ravel()).reshape(*clock.shape, -1)
    cells = forcing_basis.bumps.numpy().ravel()
    equations = np.eye(forcing_basis.fields)
    found: Array = np.einsum("ef,c,stk->steckf", equations, cells, hats)
    return found.reshape(*clock.shape, forcing_basis.count, forcing_basis.fields)


def _integrate_columns(
    tableau: Tableau, steps: Sequence[Step], begin: Array, slopes: Array, source: Array
) -> list[Array]:
    """Return the columns at every output time, each ``(column, field)``."""
    lengths = np.array([step.h for step in steps])
    turns, pushes = _propagators(tableau, lengths, slopes, source)
    columns = np.zeros(source.shape[2:])
    columns[: len(begin)] = begin
    saved = [columns]
    for step, turn, push in zip(steps, turns, pushes, strict=True):
        columns = columns @ turn + push
        if step.ends:
            saved.append(columns)
    return saved


def _propagators(tableau: Tableau, h: Array, slopes: Array, source: Array) -> tuple[Array, Array]:
    """Return what a step does to columns, ``c → c A + b``: it is linear in them.

    The columns are stepped by the method that steps the trajectory itself: then they are its exact
    derivatives.

    Returns:
        A, ``(step, field, field)``, and b, ``(step, column, field)``.
    """
    along = h[:, None, None]
    still = np.broadcast_to(np.eye(slopes.shape[-1]), slopes[:, 0].shape)
    turned: list[Array] = []
    pushed: list[Array] = []
    for stage, shares in enumerate(tableau.a):
        jacobian = slopes[:, stage].swapaxes(1, 2)
        turned.append((still + along * _weighted_sum(shares, turned)) @ jacobian)
        at = np.zeros_like(source[:, 0]) + along * _weighted_sum(shares, pushed)
        pushed.append(at @ jacobian + source[:, stage])
    return still + along * _weighted_sum(tableau.b, turned), along * _weighted_sum(
        tableau.b, pushed
    )


def _weighted_sum(shares: Sequence[float], rates: Sequence[Array]) -> Array | float:
    return sum((share * rate for share, rate in zip(shares, rates, strict=True)), 0.0)
