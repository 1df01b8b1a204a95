"""Compiled integration of groups of columns, with their Fourier transforms.

The arrays of a group fit in the cache. It is integrated over all steps of a block at once, in code
that releases the GIL.
"""

from __future__ import annotations

from rocket_fft import c2c

from dashred.physics.solvers.compiled.step import STAGES
from dashred.physics.tangents.spectral_columns.arrays import (
    BlockArrays,
    Equations,
    Modes,
    PairSources,
    Real,
    Work,
)
from dashred.physics.tangents.spectral_columns.stages import (
    apply_slopes,
    first_stage,
    gather_inputs,
    jit,
    last_stage,
    middle_stage,
)


@jit
def advance_groups(
    first: int,
    last: int,
    given: tuple[Equations, PairSources, BlockArrays, Work],
    columns: tuple[Modes, Modes, Real],
    result: Real,
) -> None:
    """Integrate the groups from ``first`` to before ``last`` over a block of steps.

    Args:
        first: index of the first group.
        last: index after the last group.
        given: the equations, the sources, the steps, and arrays of this thread.
        columns: in modes, ``(group, field, pair, mode)``, advanced in place; the same memory as
            ``(group, field, pair, *grid)``; and the factor of each column, ``(column,)``.
        result: set to the columns at output times, ``(output, column, field, point)``.
    """
    equations, sources, block, work = given
    modes, modes_grid, scales = columns
    a, b, c, end = work.stages[0], work.stages[1], work.stages[2], work.stages[3]
    norm = 1.0 / modes.shape[3]
    for group in range(first, last):
        u, saved = modes[group], 0
        gather_inputs(equations, u, work.spectra)
        for i in range(len(block.lengths)):
            step = block.coefficients[block.lengths[i]]
            for stage in range(STAGES):
                at = STAGES * i + stage
                if len(equations.reads):
                    c2c(work.spectra_grid, work.inputs_grid, equations.axes, False, norm, 1)
                    apply_slopes(equations, work.inputs, block.slopes[at], work.channels)
                    c2c(work.channels_grid, work.hats_grid, equations.axes, True, 1.0, 1)
                own = group, equations, sources, block.rows[at], block.shifts[at], work.hats
                if stage == 0:
                    first_stage(own, step, u, a, b, c, end, work.spectra)
                elif stage == 1:
                    middle_stage(own, step[2], step[4], a, b, end, work.spectra)
                elif stage == 2:
                    middle_stage(own, step[6], step[4], b, c, end, work.spectra)
                else:
                    last_stage(own, step[5], c, end, u, work.spectra)
            if block.ends[i]:
                c2c(modes_grid[group], work.points_grid, equations.axes, False, norm, 1)
                _keep(group, work.points, scales, result[saved])
                saved += 1


@jit
def _keep(group: int, points: Real, scales: Real, result: Real) -> None:
    """Write the columns of a group to ``(column, field, point)``, times their scales."""
    pairs = points.shape[1]
    for pair in range(pairs):
        for part in range(2):
            column = 2 * (group * pairs + pair) + part
            if column < len(scales):
                for field in range(len(points)):
                    value, out = points[field, pair], result[column, field]
                    for i in range(len(out)):
                        out[i] = scales[column] * value[2 * i + part]
