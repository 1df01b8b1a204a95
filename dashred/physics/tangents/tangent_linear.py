"""The derivative of a trajectory with respect to its start and to terms of its equations.

``δu' = Lδu + N'(u)δu + θ_k(u)`` is stepped along the stages of one base trajectory. Since ETDRK4
is linear in its stages, the derivative of its step is its step of the linearised tendency: the
columns are exact derivatives of what :func:`dashred.physics.solvers.simulate.simulate` computes.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from functools import partial
from itertools import islice
from typing import Any

import numpy as np
import torch
from torch import Tensor

from dashred.core.threads import in_threads
from dashred.physics.backends.numpy_backend import Pointwise
from dashred.physics.expressions.algebra import ZERO
from dashred.physics.expressions.semilinear import NotSemilinearError, semilinear_form
from dashred.physics.forcing_basis import ForcingBasis, SampledForcing
from dashred.physics.solvers.forcing import Forcing
from dashred.physics.solvers.schedule import Step, schedule
from dashred.physics.system import System, Term
from dashred.physics.tangents.reference_trajectory import STAGES, ReferenceTrajectory, Stage
from dashred.physics.tangents.semilinear_rhs import Modes, SemilinearTendency
from dashred.physics.tangents.sensitivity_columns import SensitivityIntegrator, StageBlock
from dashred.physics.tangents.sources import Sources

POINTS_AT_ONCE = 2**12
"""Stages times grid points whose slopes and sources are computed together: they stay in cache."""
COLUMN_POINTS = 2**17
"""Columns times fields times grid points that are stepped together, for the same reason."""
PRECISION: dict[torch.dtype, type[np.floating[Any]]] = {
    torch.float32: np.float32,
    torch.float64: np.float64,
}


def supports(system: System, terms: Sequence[Term]) -> bool:
    """Tell whether :func:`tangent_linear` can carry these equations, with such a forcing.

    Args:
        system: any system.
        terms: what the forcing may hold, lets and parameters resolved. Sources are free.
    """
    if not system.spectral:
        return False
    axes = [axis.name for axis in system.axes]
    try:
        empty = dict.fromkeys(system.fields, ZERO)
        added = [{**empty, term.equation: term.expression} for term in terms]
        for equations in (system.resolved, *added):
            parts = semilinear_form(equations, axes)
            for channel in parts.channels:
                parts.slopes(channel)
    except (NotSemilinearError, ArithmeticError):
        return False
    return True


@torch.no_grad()
def tangent_linear(
    system: System,
    start: Tensor,
    directions: Tensor,
    times: Tensor,
    forcing: Forcing | None,
    sources: Sequence[tuple[Term, ...]],
    dtype: torch.dtype = torch.float64,
    sampled_forcing: SampledForcing | None = None,
    forcing_basis: ForcingBasis | None = None,
) -> Iterator[tuple[Tensor, Tensor]]:
    """Yield state and tangents at every output time, the first included.

    Args:
        system: one that :func:`supports` tells yes of.
        start: ``(field, *grid)`` at ``times[0]``, float64.
        directions: ``∂u(0)/∂z``, ``(direction, field, *grid)``.
        times: output times ``(time,)``, as for ``simulate``.
        forcing: one row of further terms, part of the base trajectory and of N'.
        sources: column k is ``∂u(t)/∂ξ`` for ``∂u/∂t = … + ξ Σ_{θ in sources[k]} θ(u)`` at 0;
            lets and parameters resolved.
        dtype: precision of the tangents; the base trajectory is float64 in any case.
        sampled_forcing: a free forcing of the base trajectory, of one row.
        forcing_basis: a column for each: ``∂u(t)/∂a``.

    Yields:
        The state ``(field, *grid)``, float64, and the tangents ``(column, field, *grid)``:
        directions first, then sources, then pulses.

    Raises:
        NotSeparableError: the system is not supported.
    """
    count = (
        len(directions) + len(sources) + (forcing_basis.count if forcing_basis is not None else 0)
    )
    tangents = torch.zeros((count, *start.shape), dtype=dtype, device=start.device)
    tangents[: len(directions)] = directions
    yield start, tangents
    tendency = SemilinearTendency(system, forcing, sampled_forcing)
    driven = Sources(system, sources, len(directions), forcing_basis)
    model = _LinearisedSystem(tendency, driven, dtype)
    size = max(1, COLUMN_POINTS // start.numel())
    chunks = [range(i, min(i + size, count)) for i in range(0, count, size)]
    modes = model.reference.in_modes(start.cpu().numpy()[:, None])
    by_field = tangents.cpu().numpy().swapaxes(0, 1)
    columns = [model.columns.in_modes(by_field[:, c.start : c.stop]) for c in chunks]
    steps_at_once = max(1, POINTS_AT_ONCE // (STAGES * start[0].numel()))
    for steps in _blocks(schedule(times.tolist(), system.dt), steps_at_once):
        # A trajectory that blows up is told by its values.
        with np.errstate(all="ignore"):
            modes, states, stages = model.reference.advance(steps, modes)
            block = model.evaluate(stages)
        found = torch.zeros((len(states), *tangents.shape), dtype=dtype)
        carry = partial(_advance_chunk, model.columns, steps, chunks, block, columns, found)
        for _ in in_threads(carry, len(chunks)):
            pass
        for state, out in zip(states, found, strict=True):
            yield torch.from_numpy(state[:, 0]).to(start.device), out.to(start.device)


def _advance_chunk(
    march: SensitivityIntegrator,
    steps: Sequence[Step],
    chunks: Sequence[range],
    block: StageBlock,
    columns: list[Modes],
    found: Tensor,
    which: int,
) -> None:
    """Step one chunk of the columns, and put what it is at output times to its place."""
    chunk = chunks[which]
    with np.errstate(all="ignore"):
        columns[which], outputs = march.advance(steps, columns[which], chunk, block)
    for out, points in zip(found, outputs, strict=True):
        out[chunk.start : chunk.stop] = torch.from_numpy(points).transpose(0, 1)


class _LinearisedSystem:
    """The equations about a base trajectory, a block of steps at a time."""

    def __init__(self, tendency: SemilinearTendency, sources: Sources, dtype: torch.dtype) -> None:
        self.dtype = PRECISION[dtype]
        self.base, self.sources = ReferenceTrajectory(tendency), sources
        self.columns = SensitivityIntegrator(self.base, self.sources, self.dtype)
        self.program = Pointwise([*self.columns.slopes, *self.sources.bodies])

    def along(self, stages: Sequence[Stage]) -> StageBlock:
        """Evaluate all that the columns need, at all stages of a block at once."""
        tendency, rank, count = self.base.tendency, self.base.tendency.rank, len(stages)
        modes = np.concatenate([stage.modes for stage in stages], axis=1)
        points = np.concatenate([stage.points for stage in stages], axis=1)
        times = np.array([stage.t for stage in stages]).reshape(-1, *(1,) * rank)
        values = {**tendency.coordinates_and_inputs(times), **tendency.inputs.named(points)}
        values |= self.sources.inputs.named(self.sources.inputs(modes))
        found = self.program(values, (count, *tendency.inputs.shape))
        slopes, bodies = np.split(found, [len(self.columns.slopes)])
        rows = self.sources(bodies, modes, times, self.dtype)
        shifts = np.concatenate([stage.shift for stage in stages], axis=1)
        return StageBlock(
            _by_stage(slopes).astype(self.dtype),
            _by_stage(rows),
            _by_stage(shifts).astype(self.columns.dtype),
        )


def _by_stage(found: Modes) -> Modes:
    """Turn ``(thing, stage, …)`` into ``(stage, thing, point)``, contiguous."""
    things, stages = found.shape[:2]
    size = math.prod(found.shape[2:])
    return np.ascontiguousarray(found.reshape(things, stages, size).swapaxes(0, 1))


def _blocks(steps: Iterator[Step], size: int) -> Iterator[list[Step]]:
    while block := list(islice(steps, size)):
        yield block
