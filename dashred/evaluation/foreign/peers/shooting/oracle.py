"""The best that anybody could do: the coefficients of the true terms alone, by SciPy.

Multiple shooting with :func:`scipy.optimize.least_squares`. The method is told which terms are
missing, and not their coefficients. It minimises ``Σ (y − x)²/σ² + Σ |e_k − x_{k+1}|²/(q s)² +
|x_0 − m|²/p²`` over the coefficients and the starts x_k of segments, with their ends e_k, readings
y, noise σ, scales s, and prior m, p of the start. The fit begins with the first segment. Their
number doubles until they cover the recording, so that each begins near the trajectory, also where
the system is chaotic.

This method reads the truth: it belongs to the evaluation alone.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import OptimizeResult, least_squares

from dashred.evaluation.baselines.estimate import TermEntry
from dashred.evaluation.foreign.cases.case import Array
from dashred.evaluation.foreign.peers.measured import Measured, check_fit, entries_of
from dashred.evaluation.foreign.peers.shooting.flow import Flow
from dashred.physics.system import Term

Indices = NDArray[np.signedinteger]
SAMPLES_PER_SEGMENT = 8
# The last trajectory is continuous to this share of the scale of a field.
CONTINUITY = 1e-4
EVALUATIONS = 60
# First guesses of all coefficients, as shares of their scales.
FIRST_GUESSES = (0.0, 1.0, -1.0)
# Residual of a trajectory that blows up.
BLOWN = 1e9
# A misfit for each reading that is taken without another first guess.
GOOD_FIT = 1.3


def fit_true_form(given: Measured, form: Sequence[Term]) -> list[TermEntry]:
    """Return the true terms with fitted coefficients.

    Args:
        given: the readings.
        form: the true terms.

    Raises:
        NoAnswerError: no first guess leads to a trajectory that fits the readings.
    """
    best = np.inf
    coefficients = np.zeros(len(form))
    fit = TrueFormFit(given, form)
    scale = fit.flow.coefficient_scale(given.first_states, given.times)
    for guess in FIRST_GUESSES:
        found, misfit = fit.minimise(guess * scale)
        if misfit < best:
            best, coefficients = misfit, found
        if best < GOOD_FIT:
            break
    check_fit(best)
    return entries_of(form, coefficients)


class TrueFormFit:
    """Multiple shooting for given terms."""

    def __init__(self, given: Measured, form: Sequence[Term]) -> None:
        self.given, self.scale = given, given.scale
        self.span = float(given.times[1] - given.times[0])
        steps = max(1, round(self.span / given.system.dt))
        self.flow = Flow(given.system, form, self.scale, steps)
        self.terms, self.fields = len(form), len(given.start)
        self.count = -(-(len(given.times) - 1) // SAMPLES_PER_SEGMENT)
        self._last: tuple[Array, tuple[Array, Array]] | None = None

    def minimise(self, coefficients: Array) -> tuple[Array, float]:
        """Return the coefficients, and the cost for each reading; infinite if a fit blows up."""
        starts, segments = self.given.start[None], 1
        while True:
            try:
                solved = self._solve(coefficients, starts)
            except ArithmeticError:
                return coefficients, np.inf
            coefficients, starts = self._split(solved.x)
            if segments == self.count:
                return coefficients, 2 * float(solved.cost) / self.given.readings.size
            segments = min(2 * segments, self.count)
            starts = self._continue(coefficients, starts, segments)

    def _solve(self, coefficients: Array, starts: Array) -> OptimizeResult:
        """Fit the first segments.

        Raises:
            ArithmeticError: the trajectories from the first guess are not finite.
        """
        first = np.concatenate([coefficients, starts.ravel()])
        if not np.isfinite(self._both(first)[0]).all():
            raise ArithmeticError("the trajectories blow up")
        return least_squares(
            self._residuals,
            first,
            jac=self._jacobian,
            x_scale="jac",
            max_nfev=EVALUATIONS,
            ftol=1e-6,
        )

    def _split(self, x: Array) -> tuple[Array, Array]:
        return x[: self.terms], x[self.terms :].reshape(-1, self.fields)

    def _continue(self, coefficients: Array, starts: Array, segments: int) -> Array:
        """Return starts of more segments: as measured, else by a run from the last start."""
        given, path = self.given, list(starts)
        for number in range(len(starts), segments):
            sample = number * SAMPLES_PER_SEGMENT
            end = path[-1][None]
            for time in given.times[sample - SAMPLES_PER_SEGMENT : sample]:
                end = self.flow.advance(end, np.array([time]), coefficients[None], self.span)
            begin = np.where(np.isfinite(end[0]), end[0], path[-1])
            begin[given.columns] = given.readings[sample]
            path.append(begin)
        return np.stack(path)

    def _residuals(self, x: Array) -> Array:
        return np.nan_to_num(self._both(x)[0], nan=BLOWN, posinf=BLOWN, neginf=-BLOWN)

    def _jacobian(self, x: Array) -> Array:
        """Return the derivatives; SciPy asks for them where the residuals are finite."""
        return self._both(x)[1]

    def _both(self, x: Array) -> tuple[Array, Array]:
        """Return residuals and derivatives; the last ones are kept, as SciPy asks for each."""
        if self._last is None or not np.array_equal(self._last[0], x):
            self._last = x.copy(), self._evaluate(x)
        return self._last[1]

    def _evaluate(self, x: Array) -> tuple[Array, Array]:
        """Return the residuals ``(residual,)`` and their derivatives ``(residual, unknown)``."""
        given, fields, terms = self.given, self.fields, self.terms
        coefficients, starts = self._split(x)
        count = len(starts)
        segments = np.arange(count)
        unknowns = terms + fields * segments[:, None] + np.arange(fields)
        residuals, rows = [(starts[0] - given.start) / given.spread], [np.zeros((fields, len(x)))]
        rows[0][:, unknowns[0]] = np.diag(1 / given.spread)
        states = starts
        by_start = np.broadcast_to(np.eye(fields), (count, fields, fields))
        by_coefficients = np.zeros((count, fields, terms))
        for k in range(SAMPLES_PER_SEGMENT + 1):
            # The last sample of a segment is the first of the next one.
            is_last = k == SAMPLES_PER_SEGMENT
            sample = segments * SAMPLES_PER_SEGMENT + k
            seen = segments[(sample < len(given.times)) & (not is_last or segments == count - 1)]
            values = (states[seen][:, given.columns] - given.readings[sample[seen]]) / given.noise
            residuals.append(values.ravel())
            rows.append(
                self._rows(
                    by_start[seen][:, given.columns] / given.noise[:, None],
                    by_coefficients[seen][:, given.columns] / given.noise[:, None],
                    unknowns[seen],
                    len(x),
                )
            )
            if is_last:
                break
            times = given.times[0] + sample * self.span
            with np.errstate(all="ignore"):
                moved = self.flow(states, times, coefficients, self.span)
                by_coefficients = moved.by_coefficients + moved.by_start @ by_coefficients
                states, by_start = moved.states, moved.by_start @ by_start
        weight = 1 / (CONTINUITY * self.scale)
        residuals.append(((states[:-1] - starts[1:]) * weight).ravel())
        gaps = self._rows(
            by_start[:-1] * weight[:, None],
            by_coefficients[:-1] * weight[:, None],
            unknowns[:-1],
            len(x),
        ).reshape(count - 1, fields, len(x))
        for k in range(count - 1):
            gaps[k][:, unknowns[k + 1]] = -np.diag(weight)
        rows.append(gaps.reshape(-1, len(x)))
        return np.concatenate(residuals), np.concatenate(rows)

    def _rows(
        self, by_start: Array, by_coefficients: Array, unknowns: Indices, width: int
    ) -> Array:
        """Return rows of the Jacobian ``(batch × field, unknown)``."""
        batch, fields, _ = by_start.shape
        rows = np.zeros((batch, fields, width))
        rows[:, :, : self.terms] = by_coefficients
        for k in range(batch):
            rows[k][:, unknowns[k]] = by_start[k]
        return rows.reshape(batch * fields, width)
