"""ETDRK4 time steps of one trajectory in machine code.

The code releases the GIL, so several threads can integrate different rows of one batch.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numba
import numpy as np
from numpy.typing import NDArray

from dashred.physics.backends.numba_backend import Array, Kernel
from dashred.physics.solvers.compiled.tendency import (
    Indices,
    Modes,
    TendencyArrays,
    copy_rows,
    evaluate_nonlinear,
    mask_modes,
    to_modes,
    to_points,
    work_arrays,
)
from dashred.physics.solvers.schedule import Step

STAGES = 4
"""Stages of a step."""


class StepArrays(NamedTuple):
    """Time steps as arrays.

    Attributes:
        clock: times of the first, middle and last stages of each step, ``(step, 3)``.
        h: index of each step's length in ``lengths``, ``(step,)``.
        lengths: the different step lengths, ``(length,)``.
        begins, ends: whether the step starts or ends at an output time, ``(step,)``.
    """

    clock: Array
    h: Indices
    lengths: Array
    begins: NDArray[np.bool_]
    ends: NDArray[np.bool_]

    @classmethod
    def of(cls, steps: Sequence[Step]) -> StepArrays:
        """Return steps as arrays."""
        lengths = list(dict.fromkeys(step.h for step in steps))
        index = {h: i for i, h in enumerate(lengths)}
        return cls(
            clock=np.array([(s.first, (s.first + s.last) / 2, s.last) for s in steps]),
            h=np.array([index[step.h] for step in steps], dtype=np.int64),
            lengths=np.array(lengths),
            begins=np.array([step.begins for step in steps]),
            ends=np.array([step.ends for step in steps]),
        )

    @property
    def turns(self) -> int:
        """How often a state is transformed to modes or back, at the output times."""
        return int(self.begins.sum()) + int(self.ends.sum())


@numba.njit(nogil=True, cache=True, error_model="numpy")
def _advance(
    kernel: Kernel,
    row: int,
    tendency: TendencyArrays,
    factors: Modes,
    clock: Array,
    shape: tuple[int, ...],
    axes: tuple[int, ...],
    spectra: Modes,
    inputs: Array,
    channels: Array,
    modes: Modes,
    stages: Modes,
    rates: Modes,
) -> None:
    """Advance the modes ``(field, mode)`` of one trajectory by one step, in place.

    Args:
        kernel: evaluates the pointwise functions G.
        row: index of the trajectory.
        tendency: the nonlinear part N.
        factors: ETDRK4 coefficients of this step, ``(6, row or 1, field, mode)``.
        clock: times of its first, middle and last stages, ``(3,)``.
        shape: of the grid.
        axes: the grid axes of an array with one leading axis.
        spectra: work array of the inputs in modes.
        inputs: work array of the inputs on the grid.
        channels: work array of the channels on the grid.
        modes: the modes.
        stages: modes of the stages u, a, b and c, ``(4, field, mode)``; written.
        rates: N of the stages, ``(4, field, mode)``; written.
    """
    place = row if factors.shape[1] > 1 else 0
    full, half, q = factors[0, place], factors[1, place], factors[2, place]
    first, middle, last = factors[3, place], factors[4, place], factors[5, place]
    arguments = row, tendency, shape, axes, spectra, inputs, channels
    copy_rows(modes, stages[0])
    # One call for all stages: LLVM would copy the code of N to each call.
    for stage in range(STAGES):
        at = stages[stage]
        for f in range(len(modes)):
            for k in range(modes.shape[1]):
                if stage == 3:
                    ahead = 2 * rates[2, f, k] - rates[0, f, k]
                    at[f, k] = half[f, k] * stages[1, f, k] + q[f, k] * ahead
                elif stage > 0:
                    at[f, k] = half[f, k] * modes[f, k] + q[f, k] * rates[stage - 1, f, k]
        evaluate_nonlinear(kernel, at, clock[(stage + 1) // 2], *arguments, rates[stage])
    for f in range(len(modes)):
        for k in range(modes.shape[1]):
            both = rates[1, f, k] + rates[2, f, k]
            begin = full[f, k] * modes[f, k] + first[f, k] * rates[0, f, k]
            modes[f, k] = begin + middle[f, k] * both + last[f, k] * rates[3, f, k]


@numba.njit(nogil=True, cache=True, error_model="numpy")
def integrate_row(
    kernel: Kernel,
    row: int,
    tendency: TendencyArrays,
    steps: StepArrays,
    factors: Modes,
    shape: tuple[int, ...],
    axes: tuple[int, ...],
    counts: tuple[int, int],
    states: Array,
) -> None:
    """Integrate one row of a batch in place; stop when its state is no longer finite.

    Args:
        kernel: evaluates the pointwise functions G.
        row: index of the trajectory.
        tendency: the nonlinear part N.
        steps: the time steps.
        factors: ETDRK4 coefficients full, half, q, first, middle, last,
            ``(length, 6, row or 1, field, mode)``.
        shape: of the grid.
        axes: the grid axes of an array with one leading axis.
        counts: number of inputs and of channels of the kernel.
        states: ``(row, time, field, point)``, with the initial states at time 0 and NaN elsewhere.
    """
    fields, points = states.shape[2:]
    count = factors.shape[-1]
    modes = np.empty((fields, count), np.complex128)
    stages = np.empty((STAGES, fields, count), np.complex128)
    rates = np.empty_like(stages)
    work = work_arrays(counts, count, points)
    saved = 0
    for i in range(len(steps.h)):
        if steps.begins[i]:
            copy_rows(to_modes(states[row, saved].copy(), shape, axes), modes)
            mask_modes(modes, tendency.mask)
        clock, own = steps.clock[i], factors[steps.h[i]]
        _advance(kernel, row, tendency, own, clock, shape, axes, *work, modes, stages, rates)
        if steps.ends[i]:
            saved += 1
            copy_rows(to_points(modes, shape, axes), states[row, saved])
            if not np.isfinite(states[row, saved]).all():
                return


@numba.njit(nogil=True, cache=True, error_model="numpy")
def integrate_rows(
    kernel: Kernel,
    first: int,
    last: int,
    tendency: TendencyArrays,
    steps: StepArrays,
    factors: Modes,
    shape: tuple[int, ...],
    axes: tuple[int, ...],
    counts: tuple[int, int],
    states: Array,
) -> None:
    """Integrate the rows from ``first`` to before ``last``; see :func:`integrate_row`.

    A call from Python takes as long as some steps of a small system.
    """
    for row in range(first, last):
        integrate_row(kernel, row, tendency, steps, factors, shape, axes, counts, states)


@numba.njit(nogil=True, cache=True, error_model="numpy")
def integrate_stages(
    kernel: Kernel,
    tendency: TendencyArrays,
    steps: StepArrays,
    factors: Modes,
    shape: tuple[int, ...],
    axes: tuple[int, ...],
    counts: tuple[int, int],
    modes: Modes,
    states: Array,
    stages: Modes,
    rates: Modes,
) -> None:
    """Integrate some steps of the first row of a batch, and keep all stages.

    Args:
        kernel: evaluates the pointwise functions G.
        tendency: the nonlinear part N.
        steps: the time steps.
        factors: ETDRK4 coefficients as in :func:`integrate_row`.
        shape: of the grid.
        axes: the grid axes of an array with one leading axis.
        counts: number of inputs and of channels of the kernel.
        modes: modes of the state, ``(field, mode)``; advanced in place.
        states: states at the output times, ``(output, field, point)``; written.
        stages: modes of the stages u, a, b and c of each step, ``(step, 4, field, mode)``; written.
        rates: N of the stages, ``(step, 4, field, mode)``; written.
    """
    work = work_arrays(counts, modes.shape[1], states.shape[2])
    saved = 0
    for i in range(len(steps.h)):
        if steps.begins[i]:
            copy_rows(to_modes(to_points(modes, shape, axes), shape, axes), modes)
            mask_modes(modes, tendency.mask)
        clock, own = steps.clock[i], factors[steps.h[i]]
        _advance(kernel, 0, tendency, own, clock, shape, axes, *work, modes, stages[i], rates[i])
        if steps.ends[i]:
            copy_rows(to_points(modes, shape, axes), states[saved])
            saved += 1
