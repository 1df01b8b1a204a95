"""Integrate one trajectory with ETDRK4 and save the stages that its derivative needs."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache
from typing import NamedTuple

import numpy as np

from dashred.physics.backends.numpy_backend import Array
from dashred.physics.grids.transforms import from_modes, to_modes
from dashred.physics.solvers.etdrk4 import coefficient_derivatives, coefficients
from dashred.physics.solvers.schedule import Step
from dashred.physics.tangents.semilinear_rhs import Modes, SemilinearTendency

STAGES = 4


class Stage(NamedTuple):
    """A stage of the trajectory.

    Attributes:
        t: time.
        modes: modes of the fields, ``(field, 1, *modes)``.
        points: inputs on the grid, ``(input, 1, *grid)``.
        shift: derivative of the next stage with respect to L at constant N,
            ``(field, 1, *modes)``.
    """

    t: float
    modes: Modes
    points: Array
    shift: Modes


class ReferenceTrajectory:
    """Integrates one state in float64.

    Args:
        tendency: L and N of the equations.
    """

    def __init__(self, tendency: SemilinearTendency) -> None:
        self.tendency = tendency
        linear = tendency.linear
        self.coefficients = cache(lambda h: [c.numpy() for c in coefficients(linear, h)])
        self._coefficient_derivatives = cache(
            lambda h: [c.numpy() for c in coefficient_derivatives(linear, h)]
        )

    def in_modes(self, points: Array) -> Modes:
        """Return the modes of a state ``(field, 1, *grid)``."""
        return to_modes(points, self.tendency.rank) * self.tendency.mask

    def advance(
        self, steps: Sequence[Step], modes: Modes
    ) -> tuple[Modes, list[Array], list[Stage]]:
        """Return the final modes, the states ``(field, 1, *grid)`` at output times, and stages."""
        outputs: list[Array] = []
        stages: list[Stage] = []
        # A blow-up shows as non-finite values, not as a warning.
        with np.errstate(all="ignore"):
            for step in steps:
                if step.begins:
                    # Starts from grid values, as simulate() does.
                    modes = self.in_modes(from_modes(modes, self.tendency.inputs.shape))
                modes = self._step(modes, step, stages)
                if step.ends:
                    outputs.append(from_modes(modes, self.tendency.inputs.shape))
        return modes, outputs, stages

    def _step(self, u: Modes, step: Step, stages: list[Stage]) -> Modes:
        full, half, q, first, middle, last = self.coefficients(step.h)
        t, middle_time, end = step.t, step.t + step.h / 2, step.t + step.h
        points_u, n_u = self._rate(u, t)
        linear = half * u
        a = linear + q * n_u
        points_a, n_a = self._rate(a, middle_time)
        b = linear + q * n_a
        points_b, n_b = self._rate(b, middle_time)
        c = half * a + q * (2 * n_b - n_u)
        points_c, n_c = self._rate(c, end)
        result: Modes = full * u + first * n_u + middle * (n_a + n_b) + last * n_c
        shifts = self._shifts(step.h, u, a, (n_u, n_a, n_b, n_c))
        stages += [
            Stage(t, u, points_u, shifts[0]),
            Stage(middle_time, a, points_a, shifts[1]),
            Stage(middle_time, b, points_b, shifts[2]),
            Stage(end, c, points_c, shifts[3]),
        ]
        return result

    def _rate(self, modes: Modes, t: float) -> tuple[Array, Modes]:
        points = self.tendency.inputs(modes)
        return points, self.tendency(modes, points, t)

    def _shifts(self, h: float, u: Modes, a: Modes, rates: Sequence[Modes]) -> list[Modes]:
        full, half, q, first, middle, last = self._coefficient_derivatives(h)
        n_u, n_a, n_b, n_c = rates
        linear = half * u
        to_a = linear + q * n_u
        return [
            to_a,
            linear + q * n_a,
            half * a + q * (2 * n_b - n_u) + self.coefficients(h)[1] * to_a,
            full * u + first * n_u + middle * (n_a + n_b) + last * n_c,
        ]
