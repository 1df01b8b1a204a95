"""Tangents of an ODE system: derivatives of a trajectory by initial state, terms and forcing.

A system without axes has few unknowns and short steps. The trajectory is integrated first. Then
the Jacobians and all sources are evaluated at all stages at once, and the tangents are integrated.
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
            _derivatives_by_field(system, expr)
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
    assert system.tableau is not None
    tableau, steps = system.tableau, list(schedule(times.tolist(), system.dt))
    # A blow-up shows as non-finite values, not as a warning.
    with np.errstate(all="ignore"):
        equations = _equations(system, forcing)
        stage_times = _stage_times(tableau, steps)
        inputs = _time_and_inputs(system, stage_times)
        forced = _forcing_at_stages(system, stage_times, sampled_forcing)
        stages, states = trajectory(
            tableau, steps, start.numpy(), system.fields, equations, inputs, forced
        )
        jacobians, source = _jacobians_and_sources(system, stages, inputs, equations, sources)
        no_source = np.zeros((*source.shape[:2], *directions.shape))
        basis_source = [] if forcing_basis is None else [_basis_sources(forcing_basis, stage_times)]
        source = np.concatenate([no_source, source, *basis_source], axis=2)
        begin = directions.double().numpy()
        result = _integrate_columns(tableau, steps, begin, jacobians, source)
    for state, columns in zip(states, result, strict=True):
        yield torch.from_numpy(state), torch.from_numpy(columns)


def _stage_times(tableau: Tableau, steps: Sequence[Step]) -> Array:
    """Return the time of each stage, ``(step, stage)``."""
    return np.array([[step.t + node * step.h for node in tableau.c] for step in steps])


def _equations(system: System, forcing: Forcing | None) -> list[Expr]:
    """Return the right-hand sides with the forcing of one trajectory added."""
    added = {field: [expr] for field, expr in system.resolved.items()}
    if forcing is not None:
        [coefficients] = forcing.coefficients.tolist()
        for term, coefficient in zip(forcing.terms, coefficients, strict=True):
            added[term.equation].append(scale(coefficient, term.expression))
    return [add(added[field]) for field in system.fields]


def _derivatives_by_field(system: System, expr: Expr) -> list[Expr]:
    return [differentiate(expr, field) for field in system.fields]


def _time_and_inputs(system: System, t: Array) -> dict[str, Array]:
    return {"t": t, **system.input_signals.at(t)}


def _forcing_at_stages(
    system: System, stage_times: Array, sampled_forcing: SampledForcing | None
) -> Array:
    """Return the free forcing at each stage, ``(step, stage, field)``."""
    if sampled_forcing is None:
        return np.zeros((*stage_times.shape, len(system.fields)))
    [values] = sampled_forcing.values.numpy()
    knots = sampled_forcing.knots.numpy()
    return np.stack([np.interp(stage_times, knots, signal) for signal in values.T], axis=-1)


def _jacobians_and_sources(
    system: System,
    stages: Array,
    inputs: Mapping[str, Array],
    equations: Sequence[Expr],
    sources: Sequence[tuple[Term, ...]],
) -> tuple[Array, Array]:
    """Evaluate N' and the sources at all stages.

    Returns:
        ``(step, stage, equation, field)`` and ``(step, stage, column, equation)``.
    """
    fields = len(system.fields)
    derivatives = [slope for expr in equations for slope in _derivatives_by_field(system, expr)]
    rows: dict[tuple[int, int], list[Expr]] = {}
    for column, terms in enumerate(sources):
        for term in terms:
            place = column, system.fields.index(term.equation)
            rows.setdefault(place, []).append(term.expression)
    shape = stages.shape[:2]
    values = {**inputs, **dict(zip(system.fields, np.moveaxis(stages, -1, 0), strict=True))}
    result = Pointwise([*derivatives, *map(add, rows.values())])(values, shape)
    jacobian = np.moveaxis(result[: fields**2], 0, -1).reshape(*shape, fields, fields)
    source = np.zeros((*shape, len(sources), fields))
    for (column, equation), body in zip(rows, result[fields**2 :], strict=True):
        source[:, :, column, equation] = body
    return np.ascontiguousarray(jacobian), source


def _basis_sources(forcing_basis: ForcingBasis, stage_times: Array) -> Array:
    """Return the source of each basis function, ``(step, stage, column, equation)``."""
    hats = forcing_basis.hats(stage_times.ravel()).reshape(*stage_times.shape, -1)
    cells = forcing_basis.bumps.numpy().ravel()
    equations = np.eye(forcing_basis.fields)
    result: Array = np.einsum("ef,c,stk->steckf", equations, cells, hats)
    return result.reshape(*stage_times.shape, forcing_basis.count, forcing_basis.fields)


def _integrate_columns(
    tableau: Tableau, steps: Sequence[Step], begin: Array, jacobians: Array, source: Array
) -> list[Array]:
    """Return the columns at each output time, each ``(column, field)``."""
    lengths = np.array([step.h for step in steps])
    matrices, offsets = _propagators(tableau, lengths, jacobians, source)
    columns = np.zeros(source.shape[2:])
    columns[: len(begin)] = begin
    saved = [columns]
    for step, matrix, offset in zip(steps, matrices, offsets, strict=True):
        columns = columns @ matrix + offset
        if step.ends:
            saved.append(columns)
    return saved


def _propagators(
    tableau: Tableau, h: Array, jacobians: Array, source: Array
) -> tuple[Array, Array]:
    """Return A and b of a step of the columns c, ``c → c A + b``.

    The same method steps the trajectory and the columns, so the columns are the exact derivatives
    of the discrete trajectory.

    Returns:
        A, ``(step, field, field)``, and b, ``(step, column, field)``.
    """
    h = h[:, None, None]
    identity = np.broadcast_to(np.eye(jacobians.shape[-1]), jacobians[:, 0].shape)
    matrix_rates: list[Array] = []
    offset_rates: list[Array] = []
    for stage, shares in enumerate(tableau.a):
        jacobian = jacobians[:, stage].swapaxes(1, 2)
        matrix_rates.append((identity + h * _weighted_sum(shares, matrix_rates)) @ jacobian)
        offset = np.zeros_like(source[:, 0]) + h * _weighted_sum(shares, offset_rates)
        offset_rates.append(offset @ jacobian + source[:, stage])
    matrix = identity + h * _weighted_sum(tableau.b, matrix_rates)
    return matrix, h * _weighted_sum(tableau.b, offset_rates)


def _weighted_sum(shares: Sequence[float], rates: Sequence[Array]) -> Array | float:
    return sum((share * rate for share, rate in zip(shares, rates, strict=True)), 0.0)
