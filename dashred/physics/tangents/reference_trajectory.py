"""Integrate one trajectory with ETDRK4 and keep the stages that its derivative needs."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache
from typing import NamedTuple, Protocol

import numpy as np

from dashred.physics.backends.numpy_backend import Array
from dashred.physics.grids.transforms import from_modes, to_modes
from dashred.physics.solvers.compiled.step import STAGES
from dashred.physics.solvers.etdrk4 import coefficient_derivatives
from dashred.physics.solvers.schedule import Step
from dashred.physics.tangents.semilinear_rhs import Modes, SemilinearTendency


class Stages(NamedTuple):
    """The stages u, a, b and c of some steps of a trajectory.

    Attributes:
        t: their times, ``(stage,)``.
        modes: modes of the fields, ``(field, stage, *modes)``.
        rates: N in modes, ``(field, stage, *modes)``.
    """

    t: Array
    modes: Modes
    rates: Modes


class ReferenceTrajectory(Protocol):
    """Integrates one state in float64."""

    def advance(self, steps: Sequence[Step], modes: Modes) -> tuple[Modes, list[Array], Stages]:
        """Return the final modes, the states ``(field, 1, *grid)`` at output times, and the stages.

        Args:
            steps: the time steps.
            modes: modes of the fields, ``(field, 1, *modes)``.
        """


class InterpretedTrajectory:
    """Integrates one state with NumPy, without compilation.

    Args:
        tendency: L and N of the equations.
    """

    def __init__(self, tendency: SemilinearTendency) -> None:
        self.tendency = tendency

    def advance(self, steps: Sequence[Step], modes: Modes) -> tuple[Modes, list[Array], Stages]:
        """See :meth:`ReferenceTrajectory.advance`."""
        shape = self.tendency.inputs.shape
        outputs: list[Array] = []
        stages: list[Modes] = []
        rates: list[Modes] = []
        for step in steps:
            if step.begins:
                # Starts from grid values, as simulate() does.
                modes = in_modes(from_modes(modes, shape), self.tendency)
            modes = self._step(modes, step, stages, rates)
            if step.ends:
                outputs.append(from_modes(modes, shape))
        both = np.concatenate(stages, axis=1), np.concatenate(rates, axis=1)
        return modes, outputs, Stages(stage_times(steps), *both)

    def _step(self, u: Modes, step: Step, stages: list[Modes], rates: list[Modes]) -> Modes:
        full, half, q, first, middle, last = self.tendency.coefficients(step.h)
        begin, middle_time, _, end = stage_times([step])
        n_u = self._rate(u, begin)
        linear = half * u
        a = linear + q * n_u
        n_a = self._rate(a, middle_time)
        b = linear + q * n_a
        n_b = self._rate(b, middle_time)
        c = half * a + q * (2 * n_b - n_u)
        n_c = self._rate(c, end)
        result: Modes = full * u + first * n_u + middle * (n_a + n_b) + last * n_c
        stages += [u, a, b, c]
        rates += [n_u, n_a, n_b, n_c]
        return result

    def _rate(self, modes: Modes, t: float) -> Modes:
        return self.tendency(modes, self.tendency.inputs(modes), t)


class StageShifts:
    """Derivatives of the stages with respect to L at constant N.

    Args:
        tendency: L and N of the equations.
    """

    def __init__(self, tendency: SemilinearTendency) -> None:
        self.tendency = tendency
        self._derivatives = cache(
            lambda h: [c.numpy() for c in coefficient_derivatives(tendency.linear, h)]
        )

    def __call__(self, steps: Sequence[Step], stages: Stages) -> Modes:
        """Return the derivative of the stage after each stage, ``(field, stage, *modes)``."""
        parts = [
            np.concatenate(each, axis=1)
            for each in zip(*(self._derivatives(step.h) for step in steps), strict=True)
        ]
        full, half, q, first, middle, last = parts
        halves = [self.tendency.coefficients(step.h)[1] for step in steps]
        u, a = stages.modes[:, 0::STAGES], stages.modes[:, 1::STAGES]
        n_u, n_a, n_b, n_c = (stages.rates[:, i::STAGES] for i in range(STAGES))
        linear = half * u
        to_a = linear + q * n_u
        shifts = np.empty_like(stages.modes)
        shifts[:, 0::STAGES] = to_a
        shifts[:, 1::STAGES] = linear + q * n_a
        shifts[:, 2::STAGES] = (
            half * a + q * (2 * n_b - n_u) + np.concatenate(halves, axis=1) * to_a
        )
        shifts[:, 3::STAGES] = full * u + first * n_u + middle * (n_a + n_b) + last * n_c
        return shifts


def in_modes(points: Array, tendency: SemilinearTendency) -> Modes:
    """Return the modes of a state ``(field, 1, *grid)``."""
    return to_modes(points, tendency.rank) * tendency.mask


def stage_times(steps: Sequence[Step]) -> Array:
    """Return the times of the stages of some steps, ``(stage,)``."""
    first, last = (np.array([getattr(s, name) for s in steps]) for name in ("first", "last"))
    middle = (first + last) / 2
    return np.stack([first, middle, middle, last], axis=1).ravel()
