"""The trajectory about which the equations are linearised, with all stages, in torch."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache
from typing import NamedTuple

import torch
from torch import Tensor

from dashred.physics.grids.transforms import modes_of, points_of
from dashred.physics.solvers.etdrk4 import Coefficients, StepperCache, coefficient_derivatives
from dashred.physics.solvers.rhs import SpectralTendency
from dashred.physics.solvers.schedule import Step


class Stages(NamedTuple):
    """The stages u, a, b and c of some steps of a trajectory.

    Attributes:
        modes: modes of the fields, ``(stage, field, *modes)``.
        shifts: derivative of the stage after each stage with respect to L at constant N,
            ``(stage, field, *modes)``.
    """

    modes: Tensor
    shifts: Tensor


class ReferenceStages:
    """Integrates one state as :func:`.solvers.simulate.simulate` does, and keeps the stages.

    Args:
        tendency: L and N of the equations, for one trajectory.
    """

    def __init__(self, tendency: SpectralTendency) -> None:
        self.tendency, self.grid = tendency, tendency.system.grid
        self._calls: list[tuple[Tensor, Tensor]] = []
        self._steppers = StepperCache(tendency.linear, self._rate)
        self._derivatives = cache(lambda h: coefficient_derivatives(tendency.linear, h))

    def coefficients(self, h: float) -> Coefficients:
        """Return the coefficients of a step, ``(1, field, *modes)`` each."""
        stepper = self._steppers[h]
        return Coefficients(
            stepper.full, stepper.half, stepper.q, stepper.first, stepper.middle, stepper.last
        )

    def advance(
        self, steps: Sequence[Step], state: Tensor, modes: Tensor
    ) -> tuple[Tensor, Tensor, list[Tensor], Stages]:
        """Return the last state and modes, the states at output times, and the stages.

        Args:
            steps: the time steps.
            state: the state at the last output time, ``(1, field, *grid)``.
            modes: the modes at the first step, ``(1, field, *modes)``.
        """
        outputs, shifts = [], []
        self._calls.clear()
        for step in steps:
            if step.begins:
                modes = self.tendency.dealias(modes_of(state, self.grid.shape))
            modes = self._steppers[step.h].step(modes, step.first, step.last)
            shifts.append(self._shifts(step.h))
            if step.ends:
                state = points_of(modes, self.grid.shape)
                outputs.append(state[0])
        stages = torch.cat([u for u, _ in self._calls])
        return state, modes, outputs, Stages(stages, torch.cat(shifts))

    def _rate(self, modes: Tensor, t: float) -> Tensor:
        rate = self.tendency(modes, t)
        self._calls.append((modes, rate))
        return rate

    def _shifts(self, h: float) -> Tensor:
        """Return the shifts of the four stages of the last step, ``(4, field, *modes)``."""
        full, half, q, first, middle, last = self._derivatives(h)
        (u, n_u), (a, n_a), (_, n_b), (_, n_c) = self._calls[-4:]
        linear = half * u
        to_a = linear + q * n_u
        to_c = half * a + q * (2 * n_b - n_u) + self.coefficients(h).half * to_a
        to_end = full * u + first * n_u + middle * (n_a + n_b) + last * n_c
        return torch.cat([to_a, linear + q * n_a, to_c, to_end])
