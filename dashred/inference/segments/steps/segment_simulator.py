"""Integrate all segments of an ODE system together, with their sensitivities.

With the state x of one segment, started at its node x_k, and ``S = ∂x/∂(x_k, ξ)``::

    x' = N(x, t) + Σ_j ξ_j θ_j(x, t)        S' = (N' + Σ_j ξ_j θ_j') S + (0, θ)

Both are stepped by one Runge–Kutta method, so that S is the derivative of the discrete x. Beside
a program, N is what is added to it: a step of the program stands between two halves of a step
(:mod:`dashred.physics.solvers.splitting`).
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from dashred.inference.forward.candidates import Candidate
from dashred.inference.segments.segments import Array, Segments
from dashred.inference.segments.steps.nearby_steps import NearbySteps, step_of
from dashred.inference.segments.steps.program_step import ProgramStep
from dashred.inference.segments.steps.segment_clock import HALVES, SegmentClock
from dashred.inference.segments.tendency import Tendency
from dashred.physics.runge_kutta import CLASSICAL, Tableau
from dashred.physics.solvers.schedule import round_up
from dashred.physics.system import System

# Used instead of an adaptive method, whose derivative would depend on its choice of steps.
FALLBACK: Tableau = CLASSICAL


class SegmentSimulator:
    """One ODE system over all segments.

    Args:
        systems: of each episode; they differ in their inputs only.
        segments: of the record.
        substeps: steps from one sample to the next.
    """

    def __init__(self, systems: Sequence[System], segments: Segments, substeps: int) -> None:
        self.systems, self.segments, self.substeps = tuple(systems), segments, substeps
        self.fields = len(systems[0].fields)
        self.tableau = systems[0].tableau or FALLBACK
        program, known = systems[0].program, systems[0].config.parameters
        self.program = None if program is None else step_of(program, known)
        parts = substeps if program is None else HALVES * substeps
        self._clock = SegmentClock(self.systems, segments, parts, self.tableau.c)
        # Runge-Kutta steps from one sample to the next.
        self._parts = len(self._clock.steps) // (segments.times.shape[1] - 1)
        self._tendencies: dict[tuple[Candidate, ...], Tendency] = {}

    def with_substeps(self, substeps: int) -> SegmentSimulator:
        """Return the same with other steps."""
        return self._with(self.segments, substeps)

    def with_segments(self, segments: Segments) -> SegmentSimulator:
        """Return the same over segments with the same times and other readings."""
        return self._with(segments, self.substeps)

    def of_step(self, dt: float) -> SegmentSimulator:
        """Return the same with steps of at most ``dt``."""
        longest = float(np.diff(self.segments.times, axis=1).max())
        return self.with_substeps(max(1, round_up(longest / dt)))

    def run(
        self,
        nodes: Array,
        candidates: Sequence[Candidate],
        xi: Array,
        force: Array | float = 0.0,
    ) -> Array:
        """Return the states of all segments, ``(segment, sample, field)``.

        Args:
            nodes: states at the first sample of each, ``(segment, field)``.
            candidates: terms that are added.
            xi: their coefficients, ``(candidate,)``.
            force: added to the tendency in each segment, ``(segment, field)``.
        """
        tendency, program = self._tendency(candidates), self._changed_program(candidates, xi)
        x, saved = nodes, [nodes]
        with np.errstate(all="ignore"):
            for i, h in enumerate(self._clock.steps[:, :, None]):
                rates: list[Array] = []
                for stage, shares in enumerate(self.tableau.a):
                    at = x + h * _combined(shares, rates)
                    rates.append(tendency.rates(at, xi, self._clock.at_stage(i, stage), force))
                x = x + h * _combined(self.tableau.b, rates)
                if program is not None and i % HALVES == 0:
                    x = program.advance(i, x, *self._clock.of_program(i))
                if (i + 1) % self._parts == 0:
                    saved.append(x)
        return np.stack(saved, axis=1)

    def linearise(
        self,
        nodes: Array,
        candidates: Sequence[Candidate],
        xi: Array,
        force: Array | float = 0.0,
        forced: Sequence[int] = (),
    ) -> tuple[Array, Array]:
        """Return the states, and S ``(segment, sample, field, field + forced + candidate)``.

        Args:
            nodes: states at the first sample of each, ``(segment, field)``.
            candidates: terms that are added.
            xi: their coefficients, ``(candidate,)``.
            force: added to the tendency in each segment, ``(segment, field)``.
            forced: equations whose force is an unknown.
        """
        tendency, fields = self._tendency(candidates), self.fields
        program = self._changed_program(candidates, xi)
        known = fields + len(forced)
        own = [known + j for j in _in_program(candidates)]
        unknowns = known + len(xi)
        x, saved = nodes, [nodes]
        s = np.zeros((len(nodes), fields, unknowns))
        s[:, range(fields), range(fields)] = 1.0
        columns = [s]
        places = tendency.equations, known + tendency.owners
        forces = list(forced), range(fields, known)
        with np.errstate(all="ignore"):
            for i, h in enumerate(self._clock.steps[:, :, None]):
                rates: list[Array] = []
                slopes: list[Array] = []
                for stage, shares in enumerate(self.tableau.a):
                    at = x + h * _combined(shares, rates)
                    along = s + h[:, :, None] * _combined(shares, slopes)
                    rate, jacobian, values = tendency.linearise(
                        at, xi, self._clock.at_stage(i, stage)
                    )
                    slope = jacobian @ along
                    slope[:, places[0], places[1]] += values.T
                    slope[:, forces[0], forces[1]] += 1.0
                    rates.append(rate + force)
                    slopes.append(slope)
                x = x + h * _combined(self.tableau.b, rates)
                s = s + h[:, :, None] * _combined(self.tableau.b, slopes)
                if program is not None and i % HALVES == 0:
                    x, carried, moved = program.linearise(i, x, *self._clock.of_program(i))
                    s = carried @ s
                    s[:, :, own] += moved
                if (i + 1) % self._parts == 0:
                    saved.append(x)
                    columns.append(s)
        return np.stack(saved, axis=1), np.stack(columns, axis=1)

    def tendencies(
        self, nodes: Array, candidates: Sequence[Candidate]
    ) -> tuple[Array, Array, NDArray[np.intp], NDArray[np.intp]]:
        """Return the tendencies at the nodes: of the uncorrected equations, and of every term.

        Args:
            nodes: ``(segment, field)``.
            candidates: terms and parameters.

        Returns:
            The rates ``(segment, field)``, every term ``(term, segment)``, the equation of each
            and its candidate, ``(term,)``.
        """
        tendency = self._tendency(candidates)
        with np.errstate(all="ignore"):
            xi = np.zeros(len(candidates))
            rates, _, terms = tendency.linearise(nodes, xi, self._clock.at_stage(0, 0))
            if self.program is not None:
                begins, steps, inputs = self._clock.of_program(0)
                ends = self.program.advance(0, nodes, begins, steps, inputs)
                rates = rates + (ends - nodes) / steps[:, None]
        equations, owners = tendency.equations, tendency.owners
        own = _in_program(candidates)
        if self.program is not None and own:
            slopes = self.program.slopes([*own.values()], nodes, ends, begins, steps, inputs)
            further = np.moveaxis(slopes / steps[:, None], 1, -1).reshape(-1, len(nodes))
            terms = np.concatenate([terms, further])
            equations = np.concatenate([equations, np.tile(np.arange(self.fields), len(own))])
            owners = np.concatenate([owners, np.repeat([*own], self.fields)])
        return rates, terms, equations, owners

    @cached_property
    def samples(self) -> dict[str, Array]:
        """Time and inputs at every sample, ``(segment, sample)`` each."""
        return self._clock.at(self.segments.times)

    def forecast(self, node: Array, segment: int) -> Array:
        """Return the state at the end of one segment, ``(field,)``, without any candidate."""
        alone = self._with(self.segments.only(segment), self.substeps)
        return alone.run(node[None], (), np.zeros(0))[0, -1]

    def _with(self, segments: Segments, substeps: int) -> SegmentSimulator:
        """Return a simulator of the same systems, which shares their differentiated equations."""
        other = SegmentSimulator(self.systems, segments, substeps)
        other._tendencies = self._tendencies
        return other

    def _changed_program(
        self, candidates: Sequence[Candidate], xi: Array
    ) -> ProgramStep | NearbySteps | None:
        """Return the step of the program with the changes of its parameters."""
        own = _in_program(candidates)
        if self.program is None or not own:
            return self.program
        return self.program.at({name: float(xi[j]) for j, name in own.items()})

    def _tendency(self, candidates: Sequence[Candidate]) -> Tendency:
        key = tuple(candidates)
        if key not in self._tendencies:
            self._tendencies[key] = Tendency(self.systems[0], key)
        return self._tendencies[key]


def _in_program(candidates: Sequence[Candidate]) -> dict[int, str]:
    """Return the parameters that a program reads, by index of the candidate."""
    return {j: c.name for j, c in enumerate(candidates) if c.in_program}


def _combined(shares: Sequence[float], rates: Sequence[Array]) -> Array | float:
    return sum((c * rate for c, rate in zip(shares, rates, strict=True) if c), 0.0)
