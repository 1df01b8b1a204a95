"""The flow of a system with terms added, and its derivatives, for many states at once."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import torch

from dashred.evaluation.foreign.cases.case import Array
from dashred.physics.backends.torch_backend import Program
from dashred.physics.system import System, Term
from dashred.physics.terms.library import resolve

# Step of the forward differences, as a share of the scale of a field.
DIFFERENCE = 1e-7


class Moved(NamedTuple):
    """States after a time, and their derivatives.

    Attributes:
        states: ``(batch, field)``.
        by_start: with respect to the states before, ``(batch, field, field)``.
        by_coefficients: with respect to the coefficients, ``(batch, field, term)``.
    """

    states: Array
    by_start: Array
    by_coefficients: Array


class Flow:
    """``ẋ = N(x, t) + Σ ξ_j θ_j(x, t)`` over the time between two samples, by RK4.

    Args:
        system: N, ordinary differential equations.
        library: the terms θ.
        scale: typical size of each field, ``(field,)``, for differences with respect to the state.
        steps: number of steps of RK4 between two samples.
    """

    def __init__(self, system: System, library: Sequence[Term], scale: Array, steps: int) -> None:
        self.system, self.scale, self.steps = system, scale, steps
        known = [Term(name, system.equations[name]) for name in system.fields]
        self._program = Program([t.expression for t in resolve(system, [*library, *known])])
        self._count = len(library)
        # One where a term is in an equation, ``(field, term)``.
        self._places = np.zeros((len(system.fields), len(library)))
        for j, term in enumerate(library):
            self._places[system.fields.index(term.equation), j] = 1.0

    def columns(self, states: Array, times: Array) -> tuple[Array, Array]:
        """Return θ ``(batch, term)`` and N ``(batch, field)`` at states ``(batch, field)``."""
        values = self._program(
            self.system.values(torch.from_numpy(states), times), self.system.operators
        )
        found = [
            torch.as_tensor(self.system.operators.on_grid(v), dtype=torch.float64).expand(
                len(states)
            )
            for v in values
        ]
        both = torch.stack(found, dim=1).numpy()
        return both[:, : self._count], both[:, self._count :]

    def coefficient_scale(self, states: Array, times: Array) -> Array:
        """Return rms(N)/rms(θ) along states, N of the equation of each term, ``(term,)``."""
        terms, known = (np.sqrt(np.mean(c**2, axis=0)) for c in self.columns(states, times))
        return np.asarray(known @ self._places / terms.clip(min=1e-12))

    def rates(self, states: Array, times: Array, coefficients: Array) -> Moved:
        """Return ẋ and its derivatives."""
        batch, fields = states.shape
        moved = np.repeat(states[None], fields + 1, axis=0)
        step = DIFFERENCE * self.scale
        moved[np.arange(1, fields + 1), :, np.arange(fields)] += step[:, None]
        terms, known = self.columns(
            moved.reshape(-1, fields), np.broadcast_to(times, (fields + 1, batch)).ravel()
        )
        rates = (known + terms @ (self._places * coefficients).T).reshape(fields + 1, batch, fields)
        by_state = ((rates[1:] - rates[0]) / step[:, None, None]).transpose(1, 2, 0)
        return Moved(rates[0], by_state, self._places * terms[:batch, None, :])

    def advance(self, states: Array, times: Array, coefficients: Array, span: float) -> Array:
        """Return the states a time ``span`` after ``times``, without derivatives.

        Args:
            states: ``(batch, field)``.
            times: ``(batch,)``.
            coefficients: of each state, ``(batch, term)``.
            span: the time.
        """

        def rates(late: float, at: Array) -> Array:
            terms, known = self.columns(at, begin + late)
            return np.asarray(known + (terms * coefficients) @ self._places.T)

        step = span / self.steps
        for k in range(self.steps):
            begin = times + k * step
            first = rates(0.0, states)
            second = rates(step / 2, states + step / 2 * first)
            third = rates(step / 2, states + step / 2 * second)
            fourth = rates(step, states + step * third)
            states = states + step / 6 * (first + 2 * second + 2 * third + fourth)
        return states

    def __call__(self, states: Array, times: Array, coefficients: Array, span: float) -> Moved:
        """Return the states a time ``span`` after ``times``."""
        batch, fields = states.shape
        step = span / self.steps
        by_start = np.broadcast_to(np.eye(fields), (batch, fields, fields))
        by_coefficients = np.zeros((batch, fields, self._count))
        now = Moved(states, by_start, by_coefficients)
        for k in range(self.steps):
            now = self._step(now, times + k * step, coefficients, step)
        return now

    def _step(self, now: Moved, times: Array, coefficients: Array, step: float) -> Moved:
        total = [np.zeros_like(part) for part in now]
        stage = now
        # The weight of each stage, and how far on the next one lies.
        for weight, reach, late in ((1, 0.5, 0.0), (2, 0.5, 0.5), (2, 1.0, 0.5), (1, 0.0, 1.0)):
            rates, by_state, direct = self.rates(stage.states, times + late * step, coefficients)
            slopes = (rates, by_state @ stage.by_start, by_state @ stage.by_coefficients + direct)
            for whole, slope in zip(total, slopes, strict=True):
                whole += weight / 6 * slope
            stage = Moved(*(a + reach * step * b for a, b in zip(now, slopes, strict=True)))
        return Moved(*(a + step * b for a, b in zip(now, total, strict=True)))
