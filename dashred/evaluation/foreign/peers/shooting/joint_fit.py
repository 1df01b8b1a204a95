"""Fit the states at all samples together with the coefficients of all terms.

Minimises ``Σ (y − x)²/σ² + Σ |x_{k+1} − Φ(x_k, ξ)|²/(q s)² + |x_0 − m|²/p²`` over the states x and
the coefficients ξ, with readings y, noise σ, flow Φ from sample to sample, scales s of the fields,
and prior m, p of the start. The share q makes the equations nearly hold; it falls in steps, so that
the first trajectories follow the readings and the last ones the equations.

The normal equations of the states are banded. They are eliminated first.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.linalg import LinAlgError, solveh_banded

from dashred.evaluation.foreign.cases.case import Array
from dashred.evaluation.foreign.peers.measured import Measured
from dashred.evaluation.foreign.peers.shooting.flow import Flow
from dashred.physics.system import Term

STEPS_PER_SAMPLE = 3
# The share by which the equations may be violated at each sample, one after the other.
VIOLATIONS = (1e-1, 1e-2, 1e-3, 1e-4)
FIRST_DAMPING, LARGEST_DAMPING = 1e-3, 1e8
# The fit has ended when a step lowers the cost by less than this share.
CONVERGED = 1e-4


@dataclass(frozen=True)
class Point:
    """States and coefficients, with the cost and what the next step needs.

    Attributes:
        states: ``(time, field)``.
        coefficients: ``(term,)``.
        violation: q.
        cost: the minimised sum.
        banded: normal matrix of the states, lower banded form, ``(2 field, time field)``.
        mixed: normal matrix of states and coefficients, ``(time field, term)``.
        own: normal matrix of the coefficients, ``(term, term)``.
        slope_states: negative gradient, ``(time field,)``.
        slope_coefficients: negative gradient, ``(term,)``.
    """

    states: Array
    coefficients: Array
    violation: float
    cost: float
    banded: Array
    mixed: Array
    own: Array
    slope_states: Array
    slope_coefficients: Array

    def information(self) -> Array:
        """Return the inverse covariance of the coefficients, ``(term, term)``.

        Raises:
            LinAlgError: the states are not determined.
        """
        return self.own - self.mixed.T @ solveh_banded(self.banded, self.mixed, lower=True)

    def step(self, damping: float) -> tuple[Array, Array]:
        """Return the damped step of states and coefficients.

        Raises:
            LinAlgError: the normal matrix is singular.
        """
        banded, own = self.banded.copy(), self.own.copy()
        banded[0] *= 1 + damping
        own[np.diag_indices_from(own)] *= 1 + damping
        # A term without any effect stays as it is.
        own[np.diag_indices_from(own)] += 1e-300
        right = np.column_stack([self.slope_states, self.mixed])
        solved = solveh_banded(banded, right, lower=True, overwrite_b=True)
        alone, coupled = solved[:, 0], solved[:, 1:]
        change = np.linalg.solve(
            own - self.mixed.T @ coupled, self.slope_coefficients - self.mixed.T @ alone
        )
        return np.reshape(alone - coupled @ change, self.states.shape), np.asarray(change)


class JointFit:
    """The joint fit for given terms.

    Args:
        given: readings and simulator.
        library: terms whose coefficients are fitted.
    """

    def __init__(self, given: Measured, library: Sequence[Term]) -> None:
        self.given, self.scale = given, given.scale
        self.flow = Flow(given.system, library, self.scale, STEPS_PER_SAMPLE)

    def minimise(
        self, states: Array, coefficients: Array, violation: float, iterations: int
    ) -> Point:
        """Return the point that the Levenberg–Marquardt method reaches.

        Raises:
            ArithmeticError: the flow from the first states is not finite.
        """
        point = self.at(states, coefficients, violation)
        if point is None:
            raise ArithmeticError("the simulator blows up between two samples")
        damping = FIRST_DAMPING
        for _ in range(iterations):
            after = None
            while after is None and damping < LARGEST_DAMPING:
                after = self._try(point, damping)
                damping *= 0.1 if after is not None else 10.0
            if after is None:
                break
            converged = point.cost - after.cost < CONVERGED * after.cost
            point = after
            if converged:
                break
        return point

    def _try(self, point: Point, damping: float) -> Point | None:
        try:
            by_states, by_coefficients = point.step(damping)
        except LinAlgError:
            return None
        after = self.at(
            point.states + by_states, point.coefficients + by_coefficients, point.violation
        )
        return after if after is not None and after.cost < point.cost else None

    def at(self, states: Array, coefficients: Array, violation: float) -> Point | None:
        """Return the cost and the normal equations; None if the flow is not finite."""
        given, columns = self.given, self.given.columns
        count, fields = states.shape
        with np.errstate(all="ignore"):
            moved = self.flow(
                states[:-1], given.times[:-1], coefficients, float(given.times[1] - given.times[0])
            )
        if not all(np.isfinite(part).all() for part in moved):
            return None
        weight = 1 / (violation * self.scale)
        defects = (states[1:] - moved.states) * weight
        by_start = moved.by_start * weight[:, None]
        by_coefficients = moved.by_coefficients * weight[:, None]
        misfits = (given.readings - states[:, columns]) / given.noise
        away = (given.start - states[0]) / given.spread
        diagonal = np.zeros((count, fields, fields))
        diagonal[:-1] += by_start.transpose(0, 2, 1) @ by_start
        diagonal[1:] += np.diag(weight**2)
        diagonal[:, columns, columns] += given.noise**-2
        diagonal[0] += np.diag(given.spread**-2)
        slope = np.zeros((count, fields))
        slope[:-1] += np.einsum("kij,ki->kj", by_start, defects)
        slope[1:] -= weight * defects
        slope[:, columns] += misfits / given.noise
        slope[0] += away / given.spread
        mixed = np.zeros((count, fields, by_coefficients.shape[2]))
        mixed[:-1] += by_start.transpose(0, 2, 1) @ by_coefficients
        mixed[1:] -= weight[:, None] * by_coefficients
        flat = by_coefficients.reshape((count - 1) * fields, mixed.shape[2])
        return Point(
            states,
            coefficients,
            violation,
            float(sum(np.vdot(part, part) for part in (defects, misfits, away))),
            _banded(diagonal, -weight[:, None] * by_start),
            mixed.reshape(count * fields, mixed.shape[2]),
            flat.T @ flat,
            slope.ravel(),
            flat.T @ defects.ravel(),
        )


def _banded(diagonal: Array, below: Array) -> Array:
    """Return a block tridiagonal matrix in lower banded form.

    Args:
        diagonal: the blocks of the diagonal, ``(block, row, column)``.
        below: the blocks below it, ``(block − 1, row, column)``.
    """
    count, size, _ = diagonal.shape
    banded = np.zeros((2 * size, count, size))
    for row in range(size):
        for column in range(size):
            if row >= column:
                banded[row - column, :, column] = diagonal[:, row, column]
            banded[size + row - column, :-1, column] = below[:, row, column]
    return banded.reshape(2 * size, count * size)
