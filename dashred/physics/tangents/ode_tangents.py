"""Tangents of an ODE system: what small changes of start and forcing do, beside the trajectory.

A system without axes has few unknowns and short steps: the trajectory is marched first, then its
slopes and all sources are evaluated at every stage at once, and the columns are marched with them.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence

import numpy as np
import torch
from torch import Tensor

from dashred.physics.backends.numpy_backend import Array, Pointwise
from dashred.physics.backends.scalar_backend import NO_NUMBER, scalar_program
from dashred.physics.expressions.algebra import Expr, add, scale
from dashred.physics.expressions.differentiate import NotDifferentiableError, differentiate
from dashred.physics.forcing_basis import ForcingBasis, SampledForcing
from dashred.physics.solvers.forcing import Forcing
from dashred.physics.solvers.schedule import Step, schedule
from dashred.physics.system import System, Term

# Kutta's 3/8 rule, which the trajectories themselves are integrated by: of a linear equation along
# them its columns are then their exact derivatives.
NODES = (0.0, 1 / 3, 2 / 3, 1.0)
STAGES = ((), (1 / 3,), (-1 / 3, 1.0), (1.0, -1.0, 1.0))
WEIGHTS = (1 / 8, 3 / 8, 3 / 8, 1 / 8)

# ``(state, step, stage)`` to the rates of the fields.
Rates = Callable[[list[float], int, int], list[float]]


def supports_ode(system: System, terms: Sequence[Term]) -> bool:
    """Tell whether :func:`tangent_ode` can carry these equations, with such a forcing.

    Args:
        system: any system.
        terms: what the forcing may hold, lets and parameters resolved. Sources are free.
    """
    if system.axes or system.method != "rk4":
        return False
    try:
        for expr in (*system.resolved.values(), *(term.expression for term in terms)):
            _slopes(system, expr)
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

    The same as :func:`dashred.physics.tangents.tangent_linear.tangent_linear` for systems without axes.

    Args:
        system: one that :func:`supports_ode` tells yes of.
        start: ``(field,)`` at ``times[0]``, float64.
        directions: ``∂u(0)/∂z``, ``(direction, field)``.
        times: output times ``(time,)``.
        forcing: one row of further terms, part of the base trajectory and of N'.
        sources: column k is ``∂u(t)/∂ξ`` for ``∂u/∂t = … + ξ Σ_{θ in sources[k]} θ(u)`` at 0.
        drive: a free forcing of the base trajectory, of one row.
        pulses: a column for each: ``∂u(t)/∂a``.

    Yields:
        The state ``(field,)`` and the tangents ``(column, field)``, float64: directions first,
        then sources, then pulses.
    """
    steps = list(schedule(times.tolist(), system.dt))
    # A trajectory that blows up is told by its values.
    with np.errstate(all="ignore"):
        equations = _equations(system, forcing)
        clock = _clock(steps)
        around = _surroundings(system, clock)
        forced = _driven(system, clock, sampled_forcing)
        stages, states = _trajectory(system, steps, start.numpy(), equations, around, forced)
        slopes, source = _along(system, stages, around, equations, sources)
        still = np.zeros((*source.shape[:2], *directions.shape))
        pulsed = [] if forcing_basis is None else [_pulsed(forcing_basis, clock)]
        source = np.concatenate([still, source, *pulsed], axis=2)
        found = _columns(steps, directions.double().numpy(), slopes, source)
    for state, columns in zip(states, found, strict=True):
        yield torch.from_numpy(state), torch.from_numpy(columns)


def _clock(steps: Sequence[Step]) -> Array:
    """Return the time of every stage, ``(step, stage)``."""
    return np.array([[step.t + node * step.h for node in NODES] for step in steps])


def _equations(system: System, forcing: Forcing | None) -> list[Expr]:
    """Return the right-hand sides with the forcing of one trajectory added."""
    added = {field: [expr] for field, expr in system.resolved.items()}
    if forcing is not None:
        [coefficients] = forcing.coefficients.tolist()
        for term, coefficient in zip(forcing.terms, coefficients, strict=True):
            added[term.equation].append(scale(coefficient, term.expression))
    return [add(added[field]) for field in system.fields]


def _slopes(system: System, expr: Expr) -> list[Expr]:
    return [differentiate(expr, field) for field in system.fields]


def _surroundings(system: System, t: Array) -> dict[str, Array]:
    """Return the time and the inputs."""
    return {"t": t, **system.measured.at(t)}


def _trajectory(
    system: System,
    steps: Sequence[Step],
    start: Array,
    equations: Sequence[Expr],
    around: Mapping[str, Array],
    forced: Array,
) -> tuple[Array, Array]:
    """Return the states at every stage ``(step, stage, field)``, and at the output times."""
    pushes = forced.tolist()
    now = np.stack(list(around.values()), axis=-1).tolist()
    names = [*system.fields, *around]
    program = scalar_program(equations, names)

    def by_numbers(state: list[float], i: int, stage: int) -> list[float]:
        found = program(*state, *now[i][stage])
        return [rate + push for rate, push in zip(found, pushes[i][stage], strict=True)]

    try:
        return _march(steps, start, by_numbers)
    except NO_NUMBER:
        arrays = Pointwise(equations)

    def by_arrays(state: list[float], i: int, stage: int) -> list[float]:
        values = np.array([*state, *now[i][stage]])[:, None]
        found = arrays(dict(zip(names, values, strict=True)), (1,))[:, 0].tolist()
        return [rate + push for rate, push in zip(found, pushes[i][stage], strict=True)]

    return _march(steps, start, by_arrays)


def _march(steps: Sequence[Step], start: Array, rates: Rates) -> tuple[Array, Array]:
    """Return what :func:`_trajectory` does: Kutta's rule, of plain numbers."""
    y: list[float] = start.tolist()
    stages, saved = [], [y]
    for i, step in enumerate(steps):
        h = step.h
        k1 = rates(y, i, 0)
        second = [v + h * a / 3 for v, a in zip(y, k1, strict=True)]
        k2 = rates(second, i, 1)
        third = [v + h * (b - a / 3) for v, a, b in zip(y, k1, k2, strict=True)]
        k3 = rates(third, i, 2)
        last = [v + h * (a - b + c) for v, a, b, c in zip(y, k1, k2, k3, strict=True)]
        k4 = rates(last, i, 3)
        stages.append((y, second, third, last))
        every = zip(y, k1, k2, k3, k4, strict=True)
        y = [v + h * (a + 3 * (b + c) + d) / 8 for v, a, b, c, d in every]
        if step.ends:
            saved.append(y)
    return np.array(stages).reshape(len(steps), len(NODES), len(start)), np.array(saved)


def _driven(system: System, clock: Array, sampled_forcing: SampledForcing | None) -> Array:
    """Return the free forcing at every stage, ``(step, stage, field)``."""
    if sampled_forcing is None:
        return np.zeros((*clock.shape, len(system.fields)))
    [values] = sampled_forcing.values.numpy()
    knots = sampled_forcing.knots.numpy()
    return np.stack([np.interp(clock, knots, along) for along in values.T], axis=-1)


def _along(
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
    slopes = [slope for expr in equations for slope in _slopes(system, expr)]
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


def _pulsed(forcing_basis: ForcingBasis, clock: Array) -> Array:
    """Return what every pulse adds to the rates, ``(step, stage, column, equation)``."""
    hats = forcing_basis.hats(clock.ravel()).reshape(*clock.shape, -1)
    cells = forcing_basis.bumps.numpy().ravel()
    equations = np.eye(forcing_basis.fields)
    found: Array = np.einsum("ef,c,stk->steckf", equations, cells, hats)
    return found.reshape(*clock.shape, forcing_basis.count, forcing_basis.fields)


def _columns(steps: Sequence[Step], begin: Array, slopes: Array, source: Array) -> list[Array]:
    """Return the columns at every output time, each ``(column, field)``."""
    turns, pushes = _propagators(np.array([step.h for step in steps]), slopes, source)
    columns = np.zeros(source.shape[2:])
    columns[: len(begin)] = begin
    saved = [columns]
    for step, turn, push in zip(steps, turns, pushes, strict=True):
        columns = columns @ turn + push
        if step.ends:
            saved.append(columns)
    return saved


def _propagators(h: Array, slopes: Array, source: Array) -> tuple[Array, Array]:
    """Return what a step does to columns, ``c → c A + b``: it is linear in them.

    Returns:
        A, ``(step, field, field)``, and b, ``(step, column, field)``.
    """
    along = h[:, None, None]
    still = np.broadcast_to(np.eye(slopes.shape[-1]), slopes[:, 0].shape)
    turned: list[Array] = []
    pushed: list[Array] = []
    for stage, shares in enumerate(STAGES):
        jacobian = slopes[:, stage].swapaxes(1, 2)
        turned.append((still + along * _combined(shares, turned)) @ jacobian)
        at = np.zeros_like(source[:, 0]) + along * _combined(shares, pushed)
        pushed.append(at @ jacobian + source[:, stage])
    return still + along * _combined(WEIGHTS, turned), along * _combined(WEIGHTS, pushed)


def _combined(shares: Sequence[float], rates: Sequence[Array]) -> Array | float:
    return sum((share * rate for share, rate in zip(shares, rates, strict=True)), 0.0)
