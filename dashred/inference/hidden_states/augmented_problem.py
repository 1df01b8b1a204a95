"""A weak-constraint problem with hidden states as further fields."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from dashred.data.sensors import Sensor
from dashred.inference.forward.candidates import Candidate, ChangePrior
from dashred.inference.forward.parameter_block import ParameterBlock
from dashred.inference.segments.natural_scales import NaturalScales, natural_scales
from dashred.inference.segments.point import Point
from dashred.inference.segments.segments import Array, Segments
from dashred.inference.segments.selection.search import PRIOR, SELECTION, SegmentSearch, weighted
from dashred.inference.segments.state_sensors import StateSensors
from dashred.inference.segments.steps.segment_simulator import SegmentSimulator
from dashred.inference.segments.weak_constraint import WeakConstraintProblem
from dashred.physics.hidden_state import HiddenState, relax, with_hidden_states
from dashred.physics.parameter_sensitivity import parameter_tendency
from dashred.physics.system import System, Term
from dashred.physics.terms.library import build_library, resolve


@dataclass(frozen=True)
class Augmented:
    """A problem with hidden states, and where its fits begin.

    Attributes:
        problem: F, with the gains as the last candidates.
        natural: scales.
        point: the given values, with the nodes of the hidden states and without gains.
    """

    problem: WeakConstraintProblem
    natural: NaturalScales
    point: Point


def augment(
    found: SegmentSearch,
    begin: Point,
    sensors: Sequence[Sensor],
    states: Sequence[HiddenState],
    nodes: Sequence[Array],
    starts: Sequence[Array],
    gains: Sequence[tuple[str, str]],
) -> Augmented:
    """Return the problem of a search with hidden states, their time constants and their gains.

    Args:
        found: laws without hidden states.
        begin: values of the unknowns of their problem.
        sensors: the fit sensors.
        states: the hidden states; those with a spread of τ have a τ that is fitted.
        nodes: of each, ``(segment,)``.
        starts: expected value of each at the first sample, ``(episode,)``.
        gains: equation and term of each further candidate.
    """
    old, fields, count = found.problem, found.problem.simulator.fields, found.problem.count
    systems = [
        each.with_config(with_hidden_states(each.config, states)) for each in old.simulator.systems
    ]
    simulator = SegmentSimulator(systems, old.segments, old.simulator.substeps)
    read = StateSensors(sensors, systems[0])
    candidates = (*old.candidates, *(_gain(systems[0], *gain) for gain in gains))
    taus = [_time_constant(systems[0], each) for each in states if each.tau_spread]
    whole = np.column_stack([begin.nodes, *nodes])
    size = np.concatenate([found.natural.size, [max(float(np.std(z)), 1e-12) for z in nodes]])
    scales = natural_scales(simulator, read, candidates, whole, size, old.noise_std)
    # The scales of what the search had stay as they are.
    natural = NaturalScales(
        np.concatenate([found.natural.rate, scales.rate[fields:]]),
        size,
        np.concatenate([found.natural.coefficient, scales.coefficient[count:]]),
    )
    problem = replace(
        old,
        simulator=simulator,
        sensors=read,
        candidates=candidates,
        start_mean=np.column_stack([old.start_mean, *starts]),
        start_std=np.concatenate([old.start_std, [each.spread for each in states]]),
        parameters=ParameterBlock((*old.parameters.candidates, *taus)),
    )
    point = Point(
        whole,
        np.concatenate([begin.xi, np.zeros(len(gains))]),
        begin.walked,
        np.concatenate([begin.parameters, np.zeros(len(taus))]),
    )
    return Augmented(weighted(problem, natural, SELECTION, PRIOR), natural, point)


def hidden_course(segments: Segments, follows: Array, tau: float) -> Array:
    """Return a hidden state at every sample, ``(segment, sample)``.

    Args:
        segments: of the record.
        follows: what it follows, ``(segment, sample)``.
        tau: its time constant.
    """
    found = np.empty_like(follows)
    for episode in range(len(segments.begins)):
        mine = np.flatnonzero(segments.episode == episode)
        clock, course = segments.times[mine], follows[mine]
        flat = np.concatenate([clock[:, :-1].ravel(), clock[-1:, -1]])
        joined = np.concatenate([course[:, :-1].ravel(), course[-1:, -1]])
        # The clock of the last segment may stand still.
        later = np.concatenate([[True], np.diff(flat) > 0])
        relaxed = relax(flat[later], joined[later], tau)[np.cumsum(later) - 1]
        width = clock.shape[1] - 1
        found[mine, :-1] = relaxed[:-1].reshape(-1, width)
        found[mine, -1] = np.concatenate([found[mine[1:], 0], relaxed[-1:]])
    return found


def decay(segments: Segments, tau: float) -> Array:
    """Return what is left of a deviation at the first sample, ``(segment, sample)``."""
    begins = segments.times[segments.begins, 0][segments.episode]
    left: Array = np.exp(-(segments.times - begins[:, None]) / tau)
    return left


def _time_constant(system: System, state: HiddenState) -> Candidate:
    """Return the time constant of a hidden state as an uncertain parameter."""
    tendency = parameter_tendency(system, state.constant)
    terms = tuple(Term(equation, expr) for equation, expr in tendency.items())
    return Candidate(state.constant, None, terms, 1.0, prior=ChangePrior(0.0, state.tau_spread))


def _gain(system: System, equation: str, text: str) -> Candidate:
    [term] = build_library(system, {equation: [text]})
    return Candidate(str(term), equation, tuple(resolve(system, [term])), 1.0, is_extended=True)
