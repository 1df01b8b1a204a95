"""Derivatives of a trajectory with respect to its initial state and terms of its equations.

ETDRK4 integrates ``δu' = Lδu + N'(u)δu + θ_k(u)`` along the stages of a reference trajectory.
ETDRK4 is linear in its stages, so the derivative of a step is the same step of the linearised
equations. The columns are therefore the exact derivatives of the result of
:func:`dashred.physics.solvers.simulate.simulate`.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from itertools import islice
from typing import Any

import numpy as np
import torch
from torch import Tensor

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
from dashred.physics.tangents.semilinear_rhs import Modes, SemilinearTendency
from dashred.physics.tangents.sources import Sources
from dashred.physics.tangents.spectral_columns.equations import ColumnEquations, StageData
from dashred.physics.tangents.spectral_columns.threads import (
    Block,
    ThreadedColumns,
    columns_together,
)

POINTS_AT_ONCE = 2**12
"""Stages times grid points whose slopes and sources are computed together, to fit in the cache."""
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
            with the same others, whichever are wanted.

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
    group = columns_together(count, start.numel())
    # Whole groups are integrated, also if some of their columns are not wanted.
    first = chosen.start // group * group
    last = min(-(-chosen.stop // group) * group, count) if chosen else first
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
    by_field = tangents[first:last].cpu().numpy().swapaxes(0, 1)
    columns = ThreadedColumns(model.columns, by_field, first, group // 2)
    steps_at_once = max(1, POINTS_AT_ONCE // (STAGES * start[0].numel()))
    modes = in_modes(start.cpu().numpy()[:, None], tendency)
    steps = _blocks(schedule(times.tolist(), system.dt, system.jumps), steps_at_once)
    blocks = _evaluated(model, reference, steps, modes)
    block = next(blocks, None)
    while block is not None:
        following, result = columns.advance(block, blocks)
        for state, out in zip(block.states, torch.from_numpy(result), strict=True):
            shaped = out.reshape(last - first, *start.shape)
            yield torch.from_numpy(state[:, 0]).to(start.device), shaped[inside].to(start.device)
        block = following


def _evaluated(
    model: _LinearisedSystem,
    reference: ReferenceTrajectory,
    blocks: Iterator[Sequence[Step]],
    modes: Modes,
) -> Iterator[Block]:
    """Yield the blocks of steps along the trajectory that starts at some modes."""
    for steps in blocks:
        # A blow-up shows as non-finite values, not as a warning.
        with np.errstate(all="ignore"), torch.no_grad():
            modes, states, stages = reference.advance(steps, modes)
            data = model.evaluate(steps, stages)
        yield Block(steps, states, data)


class _LinearisedSystem:
    """The equations linearised about a reference trajectory, for blocks of steps."""

    def __init__(self, tendency: SemilinearTendency, sources: Sources, dtype: torch.dtype) -> None:
        self.dtype = PRECISION[dtype]
        self.tendency, self.sources = tendency, sources
        self.shifts = StageShifts(tendency)
        self.columns = ColumnEquations(tendency, self.sources, self.dtype)
        self.program = Pointwise([*self.columns.slopes, *self.sources.bodies])

    def evaluate(self, steps: Sequence[Step], stages: Stages) -> StageData:
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
        return StageData(
            np.ascontiguousarray(by_stage, dtype=self.dtype),
            full(rows.swapaxes(0, 1)),
            full(self.shifts(steps, stages).swapaxes(0, 1)),
        )


def _blocks(steps: Iterator[Step], size: int) -> Iterator[list[Step]]:
    while block := list(islice(steps, size)):
        yield block
