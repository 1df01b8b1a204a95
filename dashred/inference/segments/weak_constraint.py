"""Weak-constraint least squares over segments: states at all nodes, the law, and model error.

The unknowns are the state x_k at the beginning of every segment and the coefficients ξ::

    F = Σ ‖(H Φ(x_k; ξ) + b - y)/σ‖² + Σ ‖(x_{k+1} - Φ(x_k; ξ))/q‖² + Σ_e ‖(x_0 - m)/B‖² + ‖ξ/d‖²

b are errors of the sensors, whose sizes are among the coefficients ξ.

q is the model error of each field between two nodes; q → 0 is the strong constraint, one
trajectory (Trémolet, *Accounting for an imperfect model in 4D-Var*, 2006).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from dashred.core.budget import NEVER, Deadline
from dashred.inference.forward.candidates import Candidate
from dashred.inference.segments.block_tridiagonal import BlockNormal
from dashred.inference.segments.segment_simulator import SegmentSimulator
from dashred.inference.segments.segments import Array, Segments
from dashred.inference.segments.state_sensors import SensorError, StateSensors


@dataclass(frozen=True)
class Point:
    """Values of the unknowns.

    Attributes:
        nodes: x_k, ``(segment, field)``.
        xi: ξ of all sensor errors, then of all candidates, ``(coefficient,)``.
    """

    nodes: Array
    xi: Array


@dataclass(frozen=True)
class WeakConstraintProblem:
    """F with its weights.

    Attributes:
        simulator: of the segments.
        sensors: what they read of a state.
        candidates: of the model error's terms.
        noise_std: σ, ``(sensor,)``.
        model_error: q, ``(field,)``.
        start_mean: m, ``(episode, field)``.
        start_std: B, ``(field,)``.
        prior_std: d, ``(coefficient,)``.
        errors: possible errors of the sensors.
        deadline: time at which fits of it end.
    """

    simulator: SegmentSimulator
    sensors: StateSensors
    candidates: tuple[Candidate, ...]
    noise_std: Array
    model_error: Array
    start_mean: Array
    start_std: Array
    prior_std: Array
    errors: tuple[SensorError, ...] = ()
    deadline: Deadline = NEVER

    @property
    def segments(self) -> Segments:
        """The record, cut."""
        return self.simulator.segments

    @property
    def is_extended(self) -> list[bool]:
        """Whether each coefficient is of a candidate beyond the library, ``(coefficient,)``."""
        return [False] * len(self.errors) + [c.is_extended for c in self.candidates]

    @property
    def count(self) -> int:
        """Number of coefficients."""
        return len(self.errors) + len(self.candidates)

    def with_weights(self, model_error: Array, prior_std: Array) -> WeakConstraintProblem:
        """Return F with other q and d."""
        return replace(self, model_error=model_error, prior_std=prior_std)

    def with_noise(self, noise_std: Array) -> WeakConstraintProblem:
        """Return F with another σ."""
        return replace(self, noise_std=noise_std)

    def terms(self, point: Point, members: Sequence[int]) -> tuple[tuple[Candidate, ...], Array]:
        """Return the candidates among some members, and their coefficients."""
        first = len(self.errors)
        law = [j for j in members if j >= first]
        return tuple(self.candidates[j - first] for j in law), point.xi[law]

    def read(self, states: Array, point: Point, members: Sequence[int]) -> Array:
        """Return readings of states, with sensor errors, ``(segment, sample, sensor)``."""
        exact = self.sensors.read(states)
        for j, column in self._error_columns(members):
            exact = exact + point.xi[j] * column
        return exact

    def cost(self, point: Point, members: Sequence[int]) -> float:
        """Return F with some members alone; infinite where a segment blows up."""
        states = self.simulator.run(point.nodes, *self.terms(point, members))
        if not np.isfinite(states).all():
            return np.inf
        with np.errstate(over="ignore", invalid="ignore"):
            found = self._misfit(states, point, members) + self._penalty(point, members)
        return found if np.isfinite(found) else np.inf

    def linearise(self, point: Point, members: Sequence[int]) -> BlockNormal | None:
        """Return the normal equations in the nodes and some members; None if one blows up."""
        chosen = list(members)
        states, columns = self.simulator.linearise(point.nodes, *self.terms(point, chosen))
        if not (np.isfinite(states).all() and np.isfinite(columns).all()):
            return None
        segments, fields = self.segments, self.simulator.fields
        residuals, slopes = self._residuals(states, point, chosen), self.sensors.slopes(states)
        # Sensor errors do not move the states.
        errors = [column[..., None] for _, column in self._error_columns(chosen)]
        still = np.zeros((*columns.shape[:-1], len(errors)))
        own = slopes @ columns
        columns = np.concatenate([columns[..., :fields], still, columns[..., fields:]], axis=-1)
        own = np.concatenate([own[..., :fields], *errors, own[..., fields:]], axis=-1)
        own = np.where(segments.available[..., None], own / self.noise_std[:, None], 0.0)
        jacobian = own.reshape(segments.count, -1, columns.shape[-1])
        flat = residuals.reshape(segments.count, -1, 1)
        hessian = jacobian.swapaxes(1, 2) @ jacobian
        gradient = -(jacobian.swapaxes(1, 2) @ flat)[..., 0]

        defects, ahead = self._defects(point.nodes, states), columns[:-1, -1]
        weighted = np.where(segments.follows[:, None, None], ahead, 0.0)
        weighted = weighted / self.model_error[:, None]
        hessian[:-1] += weighted.swapaxes(1, 2) @ weighted
        gradient[:-1] -= (weighted.swapaxes(1, 2) @ defects[..., None])[..., 0]

        diagonal, border = hessian[:, :fields, :fields].copy(), hessian[:, :fields, fields:].copy()
        arrives = segments.follows[:, None] / self.model_error
        place = np.arange(fields)
        diagonal[1:, place, place] += arrives**2
        border[1:] -= arrives[:, :, None] * weighted[:, :, fields:]
        node_gradient = gradient[:, :fields].copy()
        node_gradient[1:] += arrives * defects
        upper = -(weighted[:, :, :fields].swapaxes(1, 2) * arrives[:, None, :])

        begins = segments.begins
        diagonal[begins[:, None], place, place] += self.start_std**-2
        node_gradient[begins] -= (point.nodes[begins] - self.start_mean) / self.start_std**2
        precision = self.prior_std[chosen] ** -2
        corner = hessian[:, fields:, fields:].sum(axis=0) + np.diag(precision)
        shared = gradient[:, fields:].sum(axis=0) - precision * point.xi[chosen]
        cost = self._misfit(states, point, chosen) + self._penalty(point, chosen)
        return BlockNormal(diagonal, upper, border, corner, node_gradient, shared, cost)

    def _error_columns(self, members: Sequence[int]) -> list[tuple[int, Array]]:
        """Return the sensor errors among some members, with their readings per unit size."""
        first = len(self.errors)
        return [(j, self.errors[j].column(self.segments)) for j in members if j < first]

    def _residuals(self, states: Array, point: Point, members: Sequence[int]) -> Array:
        """Return ``(H Φ + b - y)/σ``, ``(segment, sample, sensor)``; missing ones are zero."""
        apart = (self.read(states, point, members) - self.segments.readings) / self.noise_std
        return np.where(self.segments.available, apart, 0.0)

    def _defects(self, nodes: Array, states: Array) -> Array:
        """Return ``(Φ(x_k) - x_{k+1})/q``, ``(segment - 1, field)``; zero between episodes."""
        apart = (states[:-1, -1] - nodes[1:]) / self.model_error
        return np.where(self.segments.follows[:, None], apart, 0.0)

    def _misfit(self, states: Array, point: Point, members: Sequence[int]) -> float:
        """Return the readings' and the defects' part of F."""
        residuals = self._residuals(states, point, members)
        defects = self._defects(point.nodes, states)
        return float(np.square(residuals).sum() + np.square(defects).sum())

    def _penalty(self, point: Point, members: Sequence[int]) -> float:
        off = (point.nodes[self.segments.begins] - self.start_mean) / self.start_std
        chosen = list(members)
        law = point.xi[chosen] / self.prior_std[chosen]
        return float(np.square(off).sum() + np.square(law).sum())
