"""Exponential time differencing of finite volumes: ``v' = A v + N(v, t)`` with a dense A.

A is the linear part with coefficients that are constant in time (:mod:`.linear_part`), so that
stiff diffusion sets no limit to the step. Conditions at the ends are in N.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from functools import cache

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from dashred.physics.cells.exponential import step_matrices
from dashred.physics.cells.linear_part import linear_part
from dashred.physics.system import System

Array = NDArray[np.float64]
Rates = Callable[[Tensor, float], Tensor]
StepTuple = tuple[float, float, bool, bool, float, float]
"""``(t, h, begins, ends, first, last)`` of a step, as in :class:`.solvers.schedule.Step`."""
KEPT = 5
Reference = Callable[[Sequence[StepTuple], Array], Array]
"""(steps, cells ``(n,)`` at their start) → cells at the four stages and at the end of each step,
``(step, 5, n)``."""


class CellStepper:
    """ETDRK4 steps of the cells of a batch.

    Args:
        system: with a condition for each side of its axis.
        tendency: (fields at all points ``(batch, field, point)``, t) → their rates.
    """

    def __init__(self, system: System, tendency: Rates) -> None:
        self.extension, self.tendency = system.extension, tendency
        linear = linear_part(system)
        self.linear = torch.from_numpy(linear).T
        self._matrices = cache(
            lambda h: [torch.from_numpy(m).T.contiguous() for m in step_matrices(linear, h)]
        )

    def rest(self, cells: Tensor, t: float) -> Tensor:
        """Return N, ``(batch, n)``, of cells ``(batch, n)``."""
        fields = len(self.extension.matrices)
        states = self.extension.whole(cells.reshape(len(cells), fields, -1), t)
        rates = self.extension.cells(self.tendency(states, t)).flatten(1)
        return rates - cells @ self.linear

    def step(self, cells: Tensor, step: StepTuple) -> Tensor:
        """Return the cells ``(batch, n)`` at the end of a step."""
        *_, end = self.stages(cells, step)
        return end

    def stages(self, cells: Tensor, step: StepTuple) -> tuple[Tensor, ...]:
        """Return the cells at the four stages and at the end of the step, ``(batch, n)`` each."""
        _, h, _, _, begin, finish = step
        between = (begin + finish) / 2
        full, half, stage, first, middle, last = self._matrices(h)
        n = self.rest(cells, begin)
        damped = cells @ half
        a = damped + n @ stage
        n_a = self.rest(a, between)
        b = damped + n_a @ stage
        n_b = self.rest(b, between)
        c = a @ half + (2 * n_b - n) @ stage
        n_c = self.rest(c, finish)
        end = cells @ full + n @ first + (n_a + n_b) @ middle + n_c @ last
        return cells, a, b, c, end

    def reference(self, steps: Sequence[StepTuple], cells: Array) -> Array:
        """Return the cells at all stages of one trajectory; see :data:`Reference`."""
        found, state = [], torch.from_numpy(cells)[None]
        for step in steps:
            stages = self.stages(state, step)
            found.append(torch.cat(stages).numpy())
            state = stages[-1]
        return np.array(found)


def integrate_cells(
    system: System, tendency: Rates, start: Tensor, begin: float, steps: Iterable[StepTuple]
) -> Iterator[Tensor]:
    """Yield the fields at all points, ``(batch, field, point)``, at every output time.

    Args:
        system: with a condition for each side of its axis.
        tendency: see :class:`CellStepper`.
        start: ``(batch, field, point)``; the values at faces follow from the cells.
        begin: the first output time.
        steps: all steps.
    """
    stepper, extension = CellStepper(system, tendency), system.extension
    cells = extension.cells(start)
    shape = cells.shape
    cells = cells.flatten(1)
    yield extension.whole(cells.reshape(shape), begin)
    for step in steps:
        cells = stepper.step(cells, step)
        t, h, _, ends, *_ = step
        if ends:
            yield extension.whole(cells.reshape(shape), t + h)
