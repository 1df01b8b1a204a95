"""Derivatives of a trajectory with respect to its initial state and terms of its equations.

ETDRK4 integrates ``δu' = Lδu + N'(u)δu + θ_k(u)`` along the stages of a reference trajectory.
ETDRK4 is linear in its stages, so the derivative of a step is the same step of the linearised
equations. The columns are therefore the exact derivatives of the result of
:func:`dashred.physics.solvers.simulate.simulate`.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from functools import partial
from itertools import islice, pairwise
from typing import Any

import numpy as np
import torch
from torch import Tensor

from dashred.core.threads import in_threads
from dashred.physics.backends.numpy_backend import Pointwise
from dashred.physics.expressions.algebra import ZERO
from dashred.physics.expressions.semilinear import NotSemilinearError, semilinear_form
from dashred.physics.forcing_basis import ForcingBasis, SampledForcing
from dashred.physics.solvers.compiled.step import STAGES
from dashred.physics.solvers.forcing import Forcing
from dashred.physics.solvers.schedule import Step, schedule
from dashred.physics.system import System, Term
from dashred.physics.tangents.reference_trajectory import (
    InterpretedTrajectory,
    ReferenceTrajectory,
    Stages,
    StageShifts,
    in_modes,
)
from dashred.physics.tangents.semilinear_rhs import SemilinearTendency
from dashred.physics.tangents.sensitivity_columns import (
    Chunk,
    SensitivityIntegrator,
    StageBlock,
)
from dashred.physics.tangents.sources import Sources

POINTS_AT_ONCE = 2**12
"""Stages times grid points whose slopes and sources are computed together, to fit in the cache."""
COLUMN_POINTS = 2**17
"""Columns times fields times grid points that are integrated together, to fit in the cache."""
PRECISION: dict[torch.dtype, type[np.floating[Any]]] = {
    torch.float32: np.float32,
    torch.float64: np.float64,
}


def has_spectral_tangents(system: System, terms: Sequence[Term]) -> bool:
    """Return whether :func:`tangent_linear` supports these equations and terms.

    Args:
        system: any system.
        terms: terms of the forcing, with lets and parameters resolved. Sources may be any terms.
    """
    if not system.spectral:
        return False
    axes = [axis.name for axis in system.axes]
    try:
        empty = dict.fromkeys(system.fields, ZERO)
        added = [{**empty, term.equation: term.expression} for term in terms]
        for equations in (system.resolved, *added):
            form = semilinear_form(equations, axes)
            for channel in form.channels:
                form.slopes(channel)
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
    reference: ReferenceTrajectory | None = None,
    chosen: range | None = None,
) -> Iterator[tuple[Tensor, Tensor]]:
    """Yield state and tangents at each output time, including the first.

    Args:
        system: a system for which :func:`has_spectral_tangents` is true.
        start: ``(field, *grid)`` at ``times[0]``, float64.
        directions: ``∂u(0)/∂z``, ``(direction, field, *grid)``.
        times: output times ``(time,)``, as for ``simulate``.
        forcing: one row of additional terms, part of the reference trajectory and of N'.
        sources: column k is ``∂u(t)/∂ξ`` for ``∂u/∂t = … + ξ Σ_{θ in sources[k]} θ(u)`` at 0;
            lets and parameters resolved.
        dtype: precision of the tangents; the reference trajectory is always float64.
        sampled_forcing: free forcing of the reference trajectory, one row.
        forcing_basis: basis of a free forcing; one column ``∂u(t)/∂a`` for each coefficient a.
        reference: integrates the reference trajectory of these equations and forcings; by default
            without compilation.
        chosen: the columns that are wanted; by default all. Every column is integrated together
            with the same others, whichever are wanted, so that its bits do not depend on that.

    Yields:
        The state ``(field, *grid)``, float64, and the tangents ``(column, field, *grid)``:
        directions first, then sources, then basis functions.

    Raises:
        NotSemilinearError: the system is not supported.
    """
    basis_count = 0 if forcing_basis is None else forcing_basis.count
    count = len(directions) + len(sources) + basis_count
    chosen = range(count) if chosen is None else chosen
    tangents = torch.zeros((count, *start.shape), dtype=dtype, device=start.device)
    tangents[: len(directions)] = directions
    yield start, tangents[chosen.start : chosen.stop]
    every = columns_together(count, start.numel())
    chunks = [c for c in every if c.start < chosen.stop and chosen.start < c.stop]
    first, last = (chunks[0].start, chunks[-1].stop) if chunks else (chosen.start, chosen.start)
    tendency = SemilinearTendency(system, forcing, sampled_forcing)
    # The sources of the other columns are not evaluated.
    needed = [
        terms if first <= column < last else ()
        for column, terms in enumerate(sources, len(directions))
    ]
    basis = forcing_basis if last > count - basis_count else None
    source_terms = Sources(system, needed, len(directions), basis)
    reference = reference or InterpretedTrajectory(tendency)
    model = _LinearisedSystem(tendency, source_terms, dtype)
    inside = slice(chosen.start - first, chosen.stop - first)
    modes = in_modes(start.cpu().numpy()[:, None], tendency)
    by_field = tangents.cpu().numpy().swapaxes(0, 1)
    columns: list[Chunk] = []
    steps_at_once = max(1, POINTS_AT_ONCE // (STAGES * start[0].numel()))
    for steps in _blocks(schedule(times.tolist(), system.dt, system.jumps), steps_at_once):
        # A blow-up shows as non-finite values, not as a warning.
        with np.errstate(all="ignore"):
            modes, states, stages = reference.advance(steps, modes)
            block = model.evaluate(steps, stages)
            if not columns:
                span = steps[-1].last - steps[0].first
                columns = [
                    model.columns.begin(by_field[:, c.start : c.stop], c, block, span)
                    for c in chunks
                ]
        result = torch.zeros((len(states), last - first, *start.shape), dtype=dtype)
        advance_chunk = partial(_advance_chunk, columns, chunks, steps, block, result)
        for _ in in_threads(advance_chunk, len(chunks)):
            pass
        for state, out in zip(states, result, strict=True):
            yield torch.from_numpy(state[:, 0]).to(start.device), out[inside].to(start.device)


def columns_together(count: int, values: int) -> list[range]:
    """Return which columns are integrated together.

    If they are too many for one chunk, the number of chunks is even where the columns suffice, so
    that two processors have the same work.

    Args:
        count: number of columns.
        values: number of values of a state.
    """
    most = max(1, COLUMN_POINTS // values)
    chunks = 1 if count <= most else min(2 * math.ceil(count / (2 * most)), count)
    # Even numbers of columns, because columns are integrated in pairs.
    even = 2 if count >= 2 * chunks else 1
    edges = [even * round(i * count / (even * chunks)) for i in range(chunks)]
    return [range(first, last) for first, last in pairwise([*edges, count])]


def _advance_chunk(
    columns: Sequence[Chunk],
    chunks: Sequence[range],
    steps: Sequence[Step],
    block: StageBlock,
    result: Tensor,
    index: int,
) -> None:
    """Integrate one chunk of the columns and write its values at output times to ``result``."""
    chunk = chunks[index]
    with np.errstate(all="ignore"):
        outputs = columns[index].advance(steps, block)
    first = chunks[0].start
    for out, points in zip(result, outputs, strict=True):
        out[chunk.start - first : chunk.stop - first] = torch.from_numpy(points).transpose(0, 1)


class _LinearisedSystem:
    """The equations linearised about a reference trajectory, for blocks of steps."""

    def __init__(self, tendency: SemilinearTendency, sources: Sources, dtype: torch.dtype) -> None:
        self.dtype = PRECISION[dtype]
        self.tendency, self.sources = tendency, sources
        self.shifts = StageShifts(tendency)
        self.columns = SensitivityIntegrator(tendency, self.sources, self.dtype)
        self.program = Pointwise([*self.columns.slopes, *self.sources.bodies])

    def evaluate(self, steps: Sequence[Step], stages: Stages) -> StageBlock:
        """Evaluate slopes and sources at all stages of a block."""
        tendency, count, modes = self.tendency, len(stages.t), stages.modes
        times = stages.t.reshape(-1, *(1,) * tendency.rank)
        values = tendency.coordinates_and_inputs(times)
        values |= tendency.inputs.named(tendency.inputs(modes))
        values |= self.sources.inputs.named(self.sources.inputs(modes))
        result = self.program(values, (count, *tendency.inputs.shape))
        slopes, bodies = np.split(result, [len(self.columns.slopes)])
        rows = self.sources(bodies, modes, times, self.dtype)
        full = self.columns.full
        points = math.prod(tendency.inputs.shape)
        by_stage = slopes.reshape(*slopes.shape[:2], points).swapaxes(0, 1)
        return StageBlock(
            np.ascontiguousarray(by_stage, dtype=self.dtype),
            full(rows.swapaxes(0, 1)),
            full(self.shifts(steps, stages).swapaxes(0, 1)),
        )


def _blocks(steps: Iterator[Step], size: int) -> Iterator[list[Step]]:
    while block := list(islice(steps, size)):
        yield block
