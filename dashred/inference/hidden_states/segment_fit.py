"""Fit a hidden state over segments, with its time constant, its gain and everything else."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from dashred.data.sensors import Sensor
from dashred.inference.hidden_states.augmented_problem import augment, decay, hidden_course
from dashred.inference.hidden_states.screening import Screened, Tracked
from dashred.inference.segments.gauss_newton import NodeFit
from dashred.inference.segments.natural_scales import NaturalScales
from dashred.inference.segments.selection.candidate_sets import Set
from dashred.inference.segments.selection.search import SegmentSearch
from dashred.inference.segments.selection.set_selection import refit
from dashred.inference.segments.weak_constraint import WeakConstraintProblem
from dashred.physics.expressions.free_names import free_name
from dashred.physics.hidden_state import HiddenState

# The prior standard deviation of τ, as a share of it.
WIDE = 1.0
# τ is fitted again about its new value until it moves by less than this share, at most so often.
SETTLED, ROUNDS = 0.03, 8
# One fit changes τ by this factor at most.
FARTHEST = 3.0


@dataclass(frozen=True)
class HiddenFit:
    """A fit of one set of candidates with a hidden state.

    Attributes:
        state: the hidden state, at its fitted time constant.
        equation: the equation in which it acts.
        term: what its gain multiplies: ``z`` or ``z - u``.
        problem: F.
        natural: scales.
        fit: its minimum.
        members: candidates, the gain with them.
    """

    state: HiddenState
    equation: str
    term: str
    problem: WeakConstraintProblem
    natural: NaturalScales
    fit: NodeFit
    members: Set

    @property
    def gain(self) -> int:
        """Index of the gain among the candidates."""
        return self.problem.count - 1


def fit_screened(
    found: SegmentSearch, tracked: Tracked, sensors: Sequence[Sensor], screened: Screened
) -> HiddenFit:
    """Fit the gain, the time constant and the candidates beside them.

    The rate 1/τ enters the equations linearly, and so does the change of τ in its tangent. A fit
    is therefore exact in τ. It is repeated about the fitted value because the prior of the change
    is centred there.

    Args:
        found: laws without hidden states.
        tracked: states that track the readings.
        sensors: the fit sensors.
        screened: the hidden state.
    """
    system, segments = found.problem.simulator.systems[0], found.problem.segments
    follows, course = screened.follows, tracked.courses[screened.follows]
    name = free_name("z", system.names)
    state = HiddenState(
        name=name,
        constant=free_name(f"tau_{name}", system.names),
        follows=follows,
        tau=screened.tau,
        start="0",
        spread=max(float(np.ptp(course)), 1e-12),
        tau_spread=WIDE * screened.tau,
    )
    gain = (screened.equation, f"{name} - {follows}" if screened.is_difference else name)
    chosen, starts = (*screened.members, found.problem.count), course[segments.begins, 0]
    z = hidden_course(segments, course, state.tau) + screened.offset * decay(segments, state.tau)
    begin, nodes, point = tracked.point, z[:, 0], None
    for _ in range(ROUNDS):
        augmented = augment(found, begin, sensors, [state], [nodes], [starts], [gain])
        problem = augmented.problem
        fit = refit(problem, point or augmented.point, chosen)
        tau = changed_tau(state.tau, float(fit.point.parameters[-1]))
        is_settled = abs(tau / state.tau - 1) < SETTLED
        if is_settled or problem.deadline.is_over or not math.isfinite(fit.cost):
            break
        state = replace(state, tau=tau, tau_spread=WIDE * tau)
        point = replace(fit.point, parameters=np.append(fit.point.parameters[:-1], 0.0))
    return HiddenFit(state, *gain, problem, augmented.natural, fit, chosen)


def changed_tau(tau: float, change: float) -> float:
    """Return the time constant with the effect of a change along its tangent.

    The tangent of ``(u - z)/τ`` is ``-(u - z)/τ²``: the rate 1/τ becomes ``1/τ - change/τ²``. A
    rate of zero or less, and a large change, are bounded by a factor.
    """
    factor = 1 - change / tau
    return tau / min(max(factor, 1 / FARTHEST), FARTHEST)
