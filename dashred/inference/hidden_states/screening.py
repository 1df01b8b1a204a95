"""Screen hidden states by linear algebra: what they follow, where they act, and how fast.

The states first track the readings under a large model error. Without a gain a hidden state is
known then: it follows one of their quantities, from there or from another value at the start. The
gains of many hidden states are therefore candidates of one linearised problem.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from dashred.data.sensors import Sensor
from dashred.inference.fit.selection.subset_search import ProfiledProblem
from dashred.inference.hidden_states.augmented_problem import augment, decay, hidden_course
from dashred.inference.segments.gauss_newton import fit_nodes
from dashred.inference.segments.point import Point
from dashred.inference.segments.segments import Array
from dashred.inference.segments.selection.candidate_sets import (
    BEAM,
    LARGEST,
    Set,
    predict,
    profile,
    with_one,
)
from dashred.inference.segments.selection.search import SegmentSearch, weighted
from dashred.inference.segments.selection.set_selection import term_price
from dashred.physics.expressions import algebra
from dashred.physics.expressions.free_names import free_name
from dashred.physics.hidden_state import HiddenState

# Time constants are tried from so many samples to the length of the record, with this factor
# between two of them.
FEWEST_SAMPLES, FACTOR = 2.0, 2.0
# Model error under which the states track the readings, and the steps of this fit.
TRACKING, STEPS = 0.1, 12


@dataclass(frozen=True)
class Tracked:
    """States that track the readings.

    Attributes:
        point: values of the unknowns, without a law.
        courses: every field and input at the samples, ``(segment, sample)`` each.
    """

    point: Point
    courses: Mapping[str, Array]


@dataclass(frozen=True)
class Screened:
    """A hidden state on the linearised problem.

    Attributes:
        equation: the equation in which it acts.
        follows: what it follows.
        is_difference: whether ``z - u`` acts, not z.
        tau: its time constant.
        offset: ``z - u`` at the first sample.
        members: candidates beside it.
        size: number of candidates, with the gain and with another start.
        cost: F.
    """

    equation: str
    follows: str
    is_difference: bool
    tau: float
    offset: float
    members: Set
    size: int
    cost: float

    def score(self, level: float, price: float) -> float:
        """Return F at a misfit per reading, with the price of its candidates."""
        return self.cost / level + price * self.size


def track(found: SegmentSearch) -> Tracked:
    """Return states that track the readings, without a law."""
    empty = next(law for law in found.laws if not law.members)
    loose = weighted(found.problem, found.natural, TRACKING, 1.0)
    point = fit_nodes(loose, empty.fit.point, (), STEPS).point
    return Tracked(point, courses_of(found, point, ()))


def courses_of(found: SegmentSearch, point: Point, members: Set) -> dict[str, Array]:
    """Return every field and input at the samples, ``(segment, sample)`` each, under a law."""
    problem, states = found.problem, found.problem.states(point, members)
    segments, systems = problem.segments, problem.simulator.systems
    courses = {name: states[:, :, i] for i, name in enumerate(systems[0].fields)}
    for name in systems[0].inputs:
        courses[name] = np.empty_like(segments.times)
        for episode, driven in enumerate(systems):
            mine = segments.episode == episode
            courses[name][mine] = driven.input_signals.at(segments.times[mine])[name]
    return courses


def screen(
    found: SegmentSearch, tracked: Tracked, sensors: Sequence[Sensor], equations: Sequence[str]
) -> list[Screened]:
    """Return the best hidden states of every kind, alone and beside terms, the best first.

    Args:
        found: laws without hidden states.
        tracked: states that track the readings.
        sensors: the fit sensors.
        equations: where a hidden state may act.
    """
    every: list[Screened] = []
    for follows, acts_on in followed(found, equations).items():
        if found.problem.deadline.is_over:
            break
        every += _screen_one(found, tracked, sensors, follows, acts_on)
    level, price = least_level(found, every), term_price(found.problem)
    best: dict[tuple[str, str, bool, bool], Screened] = {}
    for each in sorted(every, key=lambda each: each.score(level, price)):
        kind = (each.equation, each.follows, each.is_difference, bool(each.members))
        best.setdefault(kind, each)
    return list(best.values())


def least_level(found: SegmentSearch, screened: Sequence[Screened]) -> float:
    """Return the lowest misfit per reading, of the best law or with a hidden state."""
    return found.problem.level([found.best.fit.cost, *(each.cost for each in screened)])


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
    tracked: Tracked,
    sensors: Sequence[Sensor],
    follows: str,
    equations: Sequence[str],
) -> Iterator[Screened]:
    """Yield the best sets with every hidden state that follows one quantity."""
    taken, segments, taus = _names(found), found.problem.segments, time_constants(found)
    course = tracked.courses[follows]
    states, nodes, gains = [], [], []
    for i, tau in enumerate(taus):
        z, rest = (free_name(f"{name}{i}", taken) for name in ("z", "rest"))
        constants = [free_name(f"tau_{name}", taken) for name in (z, rest)]
        states += [
            HiddenState(z, constants[0], follows, tau, "0", 1.0),
            # What is left of another start relaxes to zero.
            HiddenState(rest, constants[1], "0", tau, "0", 1.0),
        ]
        nodes += [hidden_course(segments, course, tau)[:, 0], decay(segments, tau)[:, 0]]
        for equation in equations:
            gains += [(equation, z), (equation, f"{z} - {follows}"), (equation, rest)]
    starts = [z[segments.begins] for z in nodes]
    augmented = augment(found, tracked.point, sensors, states, nodes, starts, gains)
    profiled = profile(augmented.problem, augmented.point)
    if profiled is None:
        return
    kinds = [(tau, equation) for tau in taus for equation in equations]
    extended = augmented.problem.is_extended
    for place, (tau, equation) in enumerate(kinds):
        first = found.problem.count + 3 * place
        for is_difference in (False, True):
            gain, left = first + is_difference, first + 2
            for chosen, cost in _best_sets(profiled, gain, left, extended):
                xi = dict(zip(chosen, profiled.coefficients(chosen).tolist(), strict=True))
                offset = xi[left] / xi[gain] if left in xi and xi[gain] else 0.0
                members = tuple(j for j in chosen if j < found.problem.count)
                yield Screened(
                    equation, follows, is_difference, tau, offset, members, len(chosen), cost
                )


def _names(found: SegmentSearch) -> frozenset[str]:
    return found.problem.simulator.systems[0].names


def _best_sets(
    profiled: ProfiledProblem, gain: int, rest: int, extended: Sequence[bool]
) -> Iterator[tuple[Set, float]]:
    """Yield the best sets of each size with a gain, alone and beside terms, with their F."""
    alone: list[Set] = [(gain,), (gain, rest)]
    sets, costs = alone[:1], predict(profiled, alone[:1])
    yield from costs.items()
    for size in range(2, LARGEST + 1):
        grown = predict(profiled, with_one(sets, extended) + alone[1:] * (size == 2))
        if not grown:
            # The library has no more terms.
            return
        sets = sorted(grown, key=grown.__getitem__)[:BEAM]
        kept = [sets[0], *(members for members in alone if members in grown)]
        yield from ((members, grown[members]) for members in dict.fromkeys(kept))
