"""Derivatives of a trajectory with respect to its initial state and terms of its equations.

ETDRK4 integrates ``δu' = Lδu + N'(u)δu + θ_k(u)`` along the stages of a reference trajectory.
ETDRK4 is linear in its stages, so the derivative of a step is the same step of the linearised
equations. The columns are therefore the exact derivatives of the result of
:func:`dashred.physics.solvers.simulate.simulate`.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from itertools import islice, pairwise
from typing import Any, NamedTuple

import numpy as np
import torch
from torch import Tensor

from dashred.core.threads import in_threads, thread_count
from dashred.physics.backends.numpy_backend import Array, Pointwise
from dashred.physics.expressions.algebra import ZERO
from dashred.physics.expressions.semilinear import NotSemilinearError, semilinear_form
from dashred.physics.forcing_basis import ForcingBasis, SampledForcing
from dashred.physics.solvers.compiled.step import STAGES
from dashred.physics.solvers.forcing import Forcing
from dashred.physics.solvers.schedule import Step, schedule
from dashred.physics.system import System, Term
from dashred.physics.tangents.column_kernels import Work
from dashred.physics.tangents.reference_trajectory import (
    InterpretedTrajectory,
    ReferenceTrajectory,
    Stages,
    StageShifts,
    in_modes,
)
from dashred.physics.tangents.semilinear_rhs import Modes, SemilinearTendency
from dashred.physics.tangents.sensitivity_columns import (
    Groups,
    SensitivityIntegrator,
    StageData,
)
from dashred.physics.tangents.sources import Sources

POINTS_AT_ONCE = 2**12
"""Stages times grid points whose slopes and sources are computed together, to fit in the cache."""
GROUP_POINTS = 2**13
"""Pairs of columns times values of a state that are integrated together, to fit in the cache."""
SHARED_POINTS = 2**18
"""Columns times values of a state from which several threads are faster than one."""
# Parts of the columns for each thread, if there are several. They are small, because one thread
# begins with the trajectory.
PARTS = 4
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
    group = columns_together(count, start.numel())
    # Whole groups are integrated, also if some of their columns are not wanted.
    first = chosen.start // group * group
    last = max(first, min(-(-chosen.stop // group) * group, count))
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
    columns = _Columns(model.columns, by_field, first, group // 2)
    steps_at_once = max(1, POINTS_AT_ONCE // (STAGES * start[0].numel()))
    modes = in_modes(start.cpu().numpy()[:, None], tendency)
    steps = _blocks(schedule(times.tolist(), system.dt, system.jumps), steps_at_once)
    blocks = _evaluated(model, reference, steps, modes)
    block = next(blocks, None)
    while block is not None:
        following, result = _advance(columns, block, blocks)
        for state, out in zip(block.states, torch.from_numpy(result), strict=True):
            shaped = out.reshape(last - first, *start.shape)
            yield torch.from_numpy(state[:, 0]).to(start.device), shaped[inside].to(start.device)
        block = following


def columns_together(count: int, values: int) -> int:
    """Return how many columns are integrated together, an even number.

    Args:
        count: number of columns.
        values: number of values of a state.
    """
    pairs = max(1, math.ceil(count / 2))
    groups = math.ceil(pairs / max(1, GROUP_POINTS // values))
    return 2 * math.ceil(pairs / groups)


class _Block(NamedTuple):
    """Some time steps.

    Attributes:
        steps: the steps.
        states: of the trajectory at output times.
        data: what the columns need of the trajectory.
    """

    steps: Sequence[Step]
    states: list[Array]
    data: StageData


def _evaluated(
    model: _LinearisedSystem,
    reference: ReferenceTrajectory,
    blocks: Iterator[Sequence[Step]],
    modes: Modes,
) -> Iterator[_Block]:
    """Yield the blocks of steps along the trajectory that starts at some modes."""
    for steps in blocks:
        # A blow-up shows as non-finite values, not as a warning.
        with np.errstate(all="ignore"):
            modes, states, stages = reference.advance(steps, modes)
            data = model.evaluate(steps, stages)
        yield _Block(steps, states, data)


class _Columns:
    """The columns, in parts for the threads.

    Attributes:
        parts: groups that are integrated in one task.
        threads: number of threads.

    Args:
        integrator: of the columns.
        points: their values at the first time, ``(field, column, *grid)``.
        first: index of the first of them.
        pairs: number of pairs in a group.
    """

    def __init__(
        self, integrator: SensitivityIntegrator, points: Array, first: int, pairs: int
    ) -> None:
        self.integrator, self._points, self._first, self._pairs = integrator, points, first, pairs
        groups = math.ceil(points.shape[1] / (2 * pairs))
        self.threads = thread_count() if points.size >= SHARED_POINTS else 1
        count = min(PARTS * self.threads if self.threads > 1 else 1, groups)
        edges = [round(i * groups / max(count, 1)) for i in range(count + 1)]
        self.parts = [range(begin, end) for begin, end in pairwise(edges)]
        self._groups: Groups | None = None
        self._work: list[Work] = []

    def begin_block(self, block: _Block) -> Array:
        """Prepare for a block, and return the array for its columns at output times."""
        fields, columns, *grid = self._points.shape
        if self._groups is None and self.parts:
            span = block.steps[-1].last - block.steps[0].first
            at = self._first, self._pairs, block.data, span
            with np.errstate(all="ignore"):
                self._groups = self.integrator.begin(self._points, *at)
            self._work = [self._groups.work() for _ in range(self.threads)]
        shape = len(block.states), columns, fields, math.prod(grid)
        return np.empty(shape, dtype=self._points.dtype)

    def advance(self, part: int, block: _Block, result: Array) -> None:
        """Integrate one part of the columns, and write it to the result at output times."""
        assert self._groups is not None
        steps = self.integrator.block(block.steps, block.data)
        # As many as threads, so there is always one left.
        work = self._work.pop()
        self._groups.advance(self.parts[part], steps, work, result)
        self._work.append(work)


def _advance(
    columns: _Columns, block: _Block, blocks: Iterator[_Block]
) -> tuple[_Block | None, Array]:
    """Return the next block, and the columns at the output times of this one."""
    result = columns.begin_block(block)
    following: list[_Block | None] = []

    def run(task: int) -> None:
        # The trajectory goes on while the columns follow it.
        if task == 0:
            following.append(next(blocks, None))
        else:
            columns.advance(task - 1, block, result)

    for _ in in_threads(run, 1 + len(columns.parts), columns.threads):
        pass
    return following[0], result


class _LinearisedSystem:
    """The equations linearised about a reference trajectory, for blocks of steps."""

    def __init__(self, tendency: SemilinearTendency, sources: Sources, dtype: torch.dtype) -> None:
        self.dtype = PRECISION[dtype]
        self.tendency, self.sources = tendency, sources
        self.shifts = StageShifts(tendency)
        self.columns = SensitivityIntegrator(tendency, self.sources, self.dtype)
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
