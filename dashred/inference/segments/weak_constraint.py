"""Weak-constraint least squares over segments: states at all nodes, the law, and model error.

The unknowns are the state x_k at the beginning of every segment and the coefficients ξ::

    F = Σ ‖(H Φ(x_k; ξ) - y)/σ‖² + Σ ‖(x_{k+1} - Φ(x_k; ξ))/q‖² + Σ_e ‖(x_0 - m)/B‖² + ‖ξ/d‖²

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
from dashred.inference.segments.state_sensors import StateSensors


@dataclass(frozen=True)
class Point:
    """Values of the unknowns.

    Attributes:
        nodes: x_k, ``(segment, field)``.
        xi: ξ of all candidates, ``(candidate,)``.
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
        prior_std: d, ``(candidate,)``.
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
    deadline: Deadline = NEVER

    @property
    def segments(self) -> Segments:
        """The record, cut."""
        return self.simulator.segments

    def with_weights(self, model_error: Array, prior_std: Array) -> WeakConstraintProblem:
        """Return F with other q and d."""
        return replace(self, model_error=model_error, prior_std=prior_std)

    def with_noise(self, noise_std: Array) -> WeakConstraintProblem:
        """Return F with another σ."""
        return replace(self, noise_std=noise_std)

    def cost(self, point: Point, members: Sequence[int]) -> float:
        """Return F with some candidates alone; infinite where a segment blows up."""
        chosen = list(members)
        states = self.simulator.run(point.nodes, self._of(chosen), point.xi[chosen])
        if not np.isfinite(states).all():
            return np.inf
        with np.errstate(over="ignore", invalid="ignore"):
            found = self._misfit(states) + self._penalty(point, chosen)
        return found if np.isfinite(found) else np.inf

    def linearise(self, point: Point, members: Sequence[int]) -> BlockNormal | None:
        """Return the normal equations in the nodes and some candidates; None if one blows up."""
        chosen = list(members)
        states, columns = self.simulator.linearise(point.nodes, self._of(chosen), point.xi[chosen])
        if not (np.isfinite(states).all() and np.isfinite(columns).all()):
            return None
        segments, fields = self.segments, self.simulator.fields
        residuals, slopes = self._residuals(states), self.sensors.slopes(states)
        slopes = np.where(segments.available[..., None], slopes / self.noise_std[:, None], 0.0)
        jacobian = (slopes @ columns).reshape(segments.count, -1, columns.shape[-1])
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
        cost = self._misfit(states) + self._penalty(point, chosen)
        return BlockNormal(diagonal, upper, border, corner, node_gradient, shared, cost)

    def _of(self, members: Sequence[int]) -> tuple[Candidate, ...]:
        return tuple(self.candidates[j] for j in members)

    def _residuals(self, states: Array) -> Array:
        """Return ``(H Φ - y)/σ``, ``(segment, sample, sensor)``; missing ones are zero."""
        apart = (self.sensors.read(states) - self.segments.readings) / self.noise_std
        return np.where(self.segments.available, apart, 0.0)

    def _defects(self, nodes: Array, states: Array) -> Array:
        """Return ``(Φ(x_k) - x_{k+1})/q``, ``(segment - 1, field)``; zero between episodes."""
        apart = (states[:-1, -1] - nodes[1:]) / self.model_error
        return np.where(self.segments.follows[:, None], apart, 0.0)

    def _misfit(self, states: Array) -> float:
        """Return the readings' and the defects' part of F."""
        nodes = states[:, 0]
        residuals, defects = self._residuals(states), self._defects(nodes, states)
        return float(np.square(residuals).sum() + np.square(defects).sum())

    def _penalty(self, point: Point, members: Sequence[int]) -> float:
        off = (point.nodes[self.segments.begins] - self.start_mean) / self.start_std
        chosen = list(members)
        law = point.xi[chosen] / self.prior_std[chosen]
        return float(np.square(off).sum() + np.square(law).sum())
