"""Weak-constraint least squares over segments: states at all nodes, the law, and model error.

The unknowns are the state x_k at the beginning of every segment, the walks u_k of forces and sensor
errors, the coefficients ξ, and the changes c of uncertain parameters::

    F = Σ ‖(H Φ(x_k; ξ, u_k) + b(u_k) - y)/σ‖² + Σ ‖(x_{k+1} - Φ(x_k; ξ, u_k))/q‖²
        + Σ ‖(u_{k+1} - A u_k)/τ‖² + Σ_e ‖(x_0 - m)/B‖² + Σ_e ‖u_0/τ_0‖² + ‖ξ/d‖² + ‖(c - c̄)/s‖²

q is the model error of each field between two nodes; q → 0 is the strong constraint, one
trajectory (Trémolet, *Accounting for an imperfect model in 4D-Var*, 2006).
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from dashred.core.budget import NEVER, Deadline
from dashred.core.numerics.block_tridiagonal import BlockNormal
from dashred.inference.forward.candidates import Candidate
from dashred.inference.forward.parameter_block import NO_PARAMETERS, ParameterBlock
from dashred.inference.segments.point import Linearisation, Point
from dashred.inference.segments.segments import Array, Segments
from dashred.inference.segments.state_sensors import ReadChanges, StateSensors
from dashred.inference.segments.steps.segment_simulator import SegmentSimulator
from dashred.inference.segments.walks import NO_WALKS, Walks

# The misfit per reading of a perfect fit is rounding error.
SMALLEST_LEVEL = 1e-12


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
        walks: forces and sensor errors.
        parameters: uncertain parameters, with c̄ and s.
        least_std: σ that cannot be undercut, ``(sensor,)``: residuals below it say nothing.
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
    walks: Walks = NO_WALKS
    parameters: ParameterBlock = NO_PARAMETERS
    least_std: Array | float = 0.0
    deadline: Deadline = NEVER

    @property
    def segments(self) -> Segments:
        """The record, cut."""
        return self.simulator.segments

    @property
    def is_extended(self) -> list[bool]:
        """Whether each candidate is beyond the library, ``(candidate,)``."""
        return [c.is_extended for c in self.candidates]

    @property
    def count(self) -> int:
        """Number of candidates."""
        return len(self.candidates)

    @property
    def noise_stds(self) -> Array:
        """σ of every reading, ``(segment, sample, sensor)`` or ``(sensor,)``."""
        return self.noise_std * self.segments.relative

    def with_weights(self, model_error: Array, prior_std: Array) -> WeakConstraintProblem:
        """Return F with other q and d."""
        return replace(self, model_error=model_error, prior_std=prior_std)

    def with_noise(self, noise_std: Array) -> WeakConstraintProblem:
        """Return F with another σ, or the least one where that is larger."""
        return replace(self, noise_std=np.maximum(noise_std, self.least_std))

    def level(self, costs: Iterable[float]) -> float:
        """Return the misfit per reading of the best of some fits, or that of the least σ.

        It is the ratio of estimated to assumed σ².
        """
        least = float(np.square(self.least_std / self.noise_std).max())
        return max(min(costs, default=np.inf) / self.segments.seen, least, SMALLEST_LEVEL)

    def terms(self, point: Point, members: Sequence[int]) -> tuple[tuple[Candidate, ...], Array]:
        """Return some candidates and their coefficients."""
        chosen = list(members)
        return tuple(self.candidates[j] for j in chosen), point.xi[chosen]

    def changes(self, point: Point, members: Sequence[int]) -> tuple[tuple[Candidate, ...], Array]:
        """Return all changes of the tendency: some candidates, then the uncertain parameters."""
        candidates, xi = self.terms(point, members)
        whole = (*candidates, *self.parameters.candidates)
        return whole, np.concatenate([xi, point.parameters])

    def states(self, point: Point, members: Sequence[int]) -> Array:
        """Return the states with some members alone, ``(segment, sample, field)``."""
        force = self.walks.forces(point.walked, self.simulator.fields)
        return self.simulator.run(point.nodes, *self.changes(point, members), force)

    def read(self, states: Array, point: Point, members: Sequence[int]) -> Array:
        """Return readings of states, with sensor errors, ``(segment, sample, sensor)``."""
        exact = self.sensors.read(states, self._read_changes(point, members))
        return exact + self.walks.errors(self.segments, point.walked)

    def _read_changes(self, point: Point, members: Sequence[int]) -> ReadChanges:
        """Return the changes of parameters that sensors depend on."""
        return self.sensors.changes(*self.changes(point, members), self.simulator.samples)

    def cost(self, point: Point, members: Sequence[int]) -> float:
        """Return F with some members alone; infinite where a segment blows up."""
        states = self.states(point, members)
        if not np.isfinite(states).all():
            return np.inf
        with np.errstate(over="ignore", invalid="ignore"):
            found = self._misfit(states, point, members) + self._penalty(point, members)
        return found if np.isfinite(found) else np.inf

    def linearise(self, point: Point, members: Sequence[int]) -> BlockNormal | None:
        """Return the normal equations in the nodes and some members; None if one blows up."""
        found = self.derivatives(point, members)
        return None if found is None else self.normal_equations(found, point, members)

    def derivatives(self, point: Point, members: Sequence[int]) -> Linearisation | None:
        """Return the states and their derivatives, whatever the weights; None if one blows up."""
        segments, walks, fields = self.segments, self.walks, self.simulator.fields
        force = walks.forces(point.walked, fields)
        states, columns = self.simulator.linearise(
            point.nodes, *self.changes(point, members), force, walks.forced
        )
        if not (np.isfinite(states).all() and np.isfinite(columns).all()):
            return None
        # The errors of the sensors do not move the states.
        before, inner = fields + len(walks.forced), fields + walks.count
        still = np.zeros((*columns.shape[:-1], inner - before))
        columns = np.concatenate([columns[..., :before], still, columns[..., before:]], axis=-1)
        changes = self._read_changes(point, members)
        readings = self.sensors.slopes(states, changes) @ columns
        if changes.names:
            places = inner + np.array(changes.places)
            readings[..., places] += self.sensors.by_parameter(states, changes)
        readings[..., fields:inner] += walks.error_slopes(segments)
        ahead = np.zeros((segments.count, inner, columns.shape[-1]))
        ahead[:, :fields] = columns[:, -1]
        ahead[:, fields:, fields:inner] = walks.transitions(segments)
        return Linearisation(states, ahead, readings)

    def normal_equations(
        self, found: Linearisation, point: Point, members: Sequence[int]
    ) -> BlockNormal:
        """Return the normal equations of F about a point.

        Args:
            found: the derivatives there.
            point: the point.
            members: candidates whose coefficients are unknowns.
        """
        segments, chosen = self.segments, list(members)
        fields, inner = self.simulator.fields, found.ahead.shape[1]
        residuals = self._residuals(found.states, point, chosen)
        own = np.where(
            segments.available[..., None], found.readings / self.noise_stds[..., None], 0.0
        )
        jacobian = own.reshape(segments.count, -1, own.shape[-1])
        flat = residuals.reshape(segments.count, -1, 1)
        hessian = jacobian.swapaxes(1, 2) @ jacobian
        gradient = -(jacobian.swapaxes(1, 2) @ flat)[..., 0]
        seen = np.einsum("kii->ki", hessian)[:, :inner].copy()

        defects, weights = self._defects(found.states, point), 1 / self._increment
        weighted = np.where(segments.follows[:, None, None], found.ahead[:-1], 0.0)
        weighted = weighted * weights[:, None]
        hessian[:-1] += weighted.swapaxes(1, 2) @ weighted
        gradient[:-1] -= (weighted.swapaxes(1, 2) @ defects[..., None])[..., 0]

        diagonal, border = hessian[:, :inner, :inner].copy(), hessian[:, :inner, inner:].copy()
        arrives = segments.follows[:, None] * weights
        place = np.arange(inner)
        diagonal[1:, place, place] += arrives**2
        border[1:] -= arrives[:, :, None] * weighted[:, :, inner:]
        node_gradient = gradient[:, :inner].copy()
        node_gradient[1:] += arrives * defects
        upper = -(weighted[:, :, :inner].swapaxes(1, 2) * arrives[:, None, :])

        begins = segments.begins
        diagonal[begins[:, None], place, place] += self._first_std**-2
        # The increments of a walk may be far smaller than the whole: they do not damp it.
        damped = np.einsum("kii->ki", diagonal).copy()
        damped[:, fields:] = seen[:, fields:]
        node_gradient[begins] -= self._off_start(point) / self._first_std
        std = np.concatenate([self.prior_std[chosen], self.parameters.stds.numpy()])
        corner = hessian[:, inner:, inner:].sum(axis=0) + np.diag(std**-2)
        shared = gradient[:, inner:].sum(axis=0) - self._off_prior(point, chosen) / std
        cost = self._misfit(found.states, point, chosen) + self._penalty(point, chosen)
        return BlockNormal(diagonal, upper, border, corner, node_gradient, shared, cost, damped)

    @property
    def _increment(self) -> Array:
        """Model error q of the fields, and τ of the walks, ``(field + component,)``."""
        return np.concatenate([self.model_error, self.walks.increment])

    @property
    def _first_std(self) -> Array:
        """Start std B of the fields, and τ_0 of the walks, ``(field + component,)``."""
        return np.concatenate([self.start_std, self.walks.first])

    def _residuals(self, states: Array, point: Point, members: Sequence[int]) -> Array:
        """Return ``(H Φ + b - y)/σ``, ``(segment, sample, sensor)``; missing ones are zero."""
        apart = (self.read(states, point, members) - self.segments.readings) / self.noise_stds
        return np.where(self.segments.available, apart, 0.0)

    def _defects(self, states: Array, point: Point) -> Array:
        """Return ``(Φ(x_k) - x_{k+1})/q`` and ``(A u_k - u_{k+1})/τ``; zero between episodes."""
        walked = np.einsum("kij,kj->ki", self.walks.transitions(self.segments), point.walked)
        apart = np.concatenate(
            [states[:-1, -1] - point.nodes[1:], walked[:-1] - point.walked[1:]], axis=1
        )
        return np.where(self.segments.follows[:, None], apart / self._increment, 0.0)

    def _off_start(self, point: Point) -> Array:
        """Return ``(x_0 - m)/B`` and ``u_0/τ_0``, ``(episode, field + component)``."""
        begins = self.segments.begins
        off = [point.nodes[begins] - self.start_mean, point.walked[begins]]
        found: Array = np.concatenate(off, axis=1) / self._first_std
        return found

    def _misfit(self, states: Array, point: Point, members: Sequence[int]) -> float:
        """Return the readings' and the defects' part of F."""
        residuals = self._residuals(states, point, members)
        defects = self._defects(states, point)
        return float(np.square(residuals).sum() + np.square(defects).sum())

    def _off_prior(self, point: Point, members: Sequence[int]) -> Array:
        """Return ``ξ/d`` and ``(c - c̄)/s``, ``(member + parameter,)``."""
        chosen, known = list(members), self.parameters
        law = point.xi[chosen] / self.prior_std[chosen]
        changes = (point.parameters - known.means.numpy()) / known.stds.numpy()
        return np.concatenate([law, changes])

    def _penalty(self, point: Point, members: Sequence[int]) -> float:
        off = self._off_start(point), self._off_prior(point, members)
        return float(sum(np.square(each).sum() for each in off))
