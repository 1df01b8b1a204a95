"""Screen hidden states by linear algebra: what they follow, where they act, and how fast.

Without a gain a hidden state is known: it follows a quantity of the fitted law. The gains of many
hidden states are therefore candidates of one linearised problem.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from dashred.data.sensors import Sensor
from dashred.inference.fit.subset_search import ProfiledProblem
from dashred.inference.hidden_states.augmented_problem import augment
from dashred.inference.segments.segments import Array
from dashred.inference.segments.selection.candidate_sets import (
    BEAM,
    LARGEST,
    Set,
    predict,
    profile,
    with_one,
)
from dashred.inference.segments.selection.search import SegmentSearch
from dashred.inference.segments.selection.set_selection import SegmentLaw
from dashred.physics.expressions import algebra
from dashred.physics.hidden_state import HiddenState, free_name

# Time constants are tried from so many samples to the length of the record, with this factor
# between two of them.
FEWEST_SAMPLES, FACTOR = 2.0, 2.0


@dataclass(frozen=True)
class Screened:
    """A hidden state with its best time constant on the linearised problem.

    Attributes:
        equation: the equation in which it acts.
        follows: what it follows.
        is_difference: whether ``z - u`` acts, not z.
        tau: its time constant.
        members: candidates beside it.
        cost: F.
    """

    equation: str
    follows: str
    is_difference: bool
    tau: float
    members: Set
    cost: float


def courses_of(found: SegmentSearch, law: SegmentLaw) -> dict[str, Array]:
    """Return every field and input at the samples, ``(segment, sample)`` each."""
    problem, states = found.problem, found.states(law)
    simulator, segments = problem.simulator, problem.segments
    system = simulator.systems[0]
    courses = {name: states[:, :, i] for i, name in enumerate(system.fields)}
    for name in system.inputs:
        courses[name] = np.empty_like(segments.times)
        for episode, driven in enumerate(simulator.systems):
            mine = segments.episode == episode
            courses[name][mine] = driven.input_signals.at(segments.times[mine])[name]
    return courses


def screen(
    found: SegmentSearch,
    law: SegmentLaw,
    sensors: Sequence[Sensor],
    equations: Sequence[str],
    courses: Mapping[str, Array],
) -> list[Screened]:
    """Return the best of every kind of hidden state, the best first.

    Args:
        found: laws without hidden states.
        law: the law about whose states they are screened.
        sensors: the fit sensors.
        equations: where a hidden state may act.
        courses: every field and input at the samples, ``(segment, sample)`` each.
    """
    best: dict[tuple[str, str, bool], Screened] = {}
    taus = time_constants(found)
    for follows, acts_on in followed(found, equations).items():
        for each in _screen_one(found, law, sensors, follows, acts_on, taus, courses):
            kind = (each.equation, each.follows, each.is_difference)
            if kind not in best or each.cost < best[kind].cost:
                best[kind] = each
    return sorted(best.values(), key=lambda each: each.cost)


def time_constants(found: SegmentSearch) -> list[float]:
    """Return the time constants that are tried."""
    times = found.problem.segments.times
    steps = np.diff(times, axis=1)
    least = FEWEST_SAMPLES * float(np.median(steps[steps > 0]))
    most = max(
        float(np.ptp(times[found.problem.segments.episode == episode]))
        for episode in range(len(found.problem.segments.begins))
    )
    count = max(2, math.ceil(math.log(most / least) / math.log(FACTOR)) + 1)
    return list(np.geomspace(least, most, count))


def followed(found: SegmentSearch, equations: Sequence[str]) -> dict[str, list[str]]:
    """Return what a hidden state may follow, and the equations in which it may then act.

    It acts in an equation that reads what it follows, or in that of the field which it follows.
    """
    system = found.problem.simulator.systems[0]
    read = {f: algebra.names(system.resolved[f]) | {f} for f in equations}
    given = [*system.fields, *system.inputs]
    acts = {name: [f for f in equations if name in read[f]] for name in given}
    return {name: where for name, where in acts.items() if where}


def _screen_one(
    found: SegmentSearch,
    law: SegmentLaw,
    sensors: Sequence[Sensor],
    follows: str,
    equations: Sequence[str],
    taus: Sequence[float],
    courses: Mapping[str, Array],
) -> Iterator[Screened]:
    """Yield the best sets with every hidden state that follows one quantity."""
    taken, spread = found.problem.simulator.systems[0].names, float(np.std(courses[follows]))
    states = [
        HiddenState(free_name(f"z{i}", taken), free_name(f"tau{i}", taken), follows, tau, "0", spread)
        for i, tau in enumerate(taus)
    ]
    kinds = [
        (f, s.name if not difference else f"{s.name} - {follows}", difference, s.tau)
        for f in equations
        for s in states
        for difference in (False, True)
    ]
    augmented = augment(found, law, sensors, states, [kind[:2] for kind in kinds], courses)
    profiled = profile(augmented.problem, augmented.point)
    if profiled is None:
        return
    known, extended = found.problem.count, augmented.problem.is_extended
    for j, (equation, _, difference, tau) in enumerate(kinds, start=known):
        members, cost = _best_set(profiled, j, extended, found)
        yield Screened(equation, follows, difference, tau, members, cost)


def _best_set(
    profiled: ProfiledProblem, gain: int, extended: Sequence[bool], found: SegmentSearch
) -> tuple[Set, float]:
    """Return the set of a few library terms beside a gain that has the lowest score."""
    price = 2 * math.log(len(extended)) + math.log(found.problem.segments.seen)
    sets, costs = [(gain,)], predict(profiled, [(gain,)])
    for _ in range(LARGEST - 1):
        grown = predict(profiled, with_one(sets, extended))
        sets = sorted(grown, key=grown.__getitem__)[:BEAM]
        costs |= {members: grown[members] for members in sets}
    best = min(costs, key=lambda s: costs[s] + price * len(s))
    return tuple(j for j in best if j != gain), costs[best]
