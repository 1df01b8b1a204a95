"""Sensor errors and forces are found beside a law, and none where there is nothing to find."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from dashred.inference.fit.law import Law
from dashred.inference.segments.findings.segment_laws import law_from_segments
from dashred.inference.segments.first_nodes import first_nodes
from dashred.inference.segments.natural_scales import field_sizes, natural_scales
from dashred.inference.segments.segments import Array, cut
from dashred.inference.segments.selection.beside_law import (
    force_beside,
    search_beside_errors,
    unexplained_force,
)
from dashred.inference.segments.selection.search import SegmentSearch, search
from tests.inference.segments.conftest import MEAN, NOISE, TIMES, Convection, weak_problem

NAMES = ("x: x", "x: y*z", "y: x", "y: y", "y: x*z", "z: x", "z: z", "z: x*y")
Find = Callable[[Array], SegmentSearch]


@pytest.fixture
def find(convection: Convection) -> Find:
    """Search the law of some readings of x and y."""

    def run(readings: Array) -> SegmentSearch:
        simulator = convection.simulator.with_segments(cut([TIMES], [readings]))
        size = field_sizes(simulator.segments, convection.sensors, np.full(3, 8.0))
        guesses = first_nodes(simulator, convection.sensors, MEAN, size)
        chosen = tuple(convection.candidates[convection.index(name)] for name in NAMES)
        scales = natural_scales(simulator, convection.sensors, chosen, guesses[-1], size)
        problem = replace(
            weak_problem(convection),
            simulator=simulator,
            candidates=chosen,
            prior_std=np.ones(len(chosen)),
        )
        return search(problem, guesses, scales)

    return run


def beside(found: SegmentSearch) -> tuple[SegmentSearch, Law]:
    again = search_beside_errors(found)
    assert again is not None
    return again, law_from_segments(again, again.best)


@pytest.mark.parametrize(("kind", "size"), [("bias", 1.5), ("drift", 0.2)])
def test_a_steady_error_is_found_beside_the_missing_damping(
    convection: Convection, find: Find, kind: str, size: float
) -> None:
    shape = np.ones_like(TIMES) if kind == "bias" else TIMES
    _, law = beside(find(convection.readings + np.outer(size * shape, [0, 1])))
    assert [str(candidate) for candidate in law.candidates] == ["y: y"]
    assert float(law.coefficients[0]) == pytest.approx(-1.0, abs=0.05)
    [fault] = law.faults
    assert (fault.kind, fault.sensor) == (kind, "y")
    assert fault.std is not None and fault.std < 0.1 * size
    assert fault.value == pytest.approx(size, abs=4 * fault.std)


def test_an_error_of_any_shape_is_found_as_a_curve(convection: Convection, find: Find) -> None:
    error = TIMES / 6 * np.sin(1.6 * TIMES)
    _, law = beside(find(convection.readings + np.outer(error, [1, 0])))
    assert [str(candidate) for candidate in law.candidates] == ["y: y"]
    [fault] = law.faults
    assert (fault.kind, fault.sensor) == ("wandering", "x")
    [curve] = fault.curves
    exact = np.interp(curve.times, TIMES, error)
    off = (np.array(curve.value) - exact) / np.array(curve.std)
    assert np.sqrt(np.mean(off**2)) < 1.5 and max(curve.std) < 3 * NOISE


def test_an_error_that_comes_and_goes(convection: Convection, find: Find) -> None:
    error = np.where((TIMES > 4.07) & (TIMES < 7.3), 2.0, 0.0)
    again, law = beside(find(convection.readings + np.outer(error, [0, 1])))
    assert [str(candidate) for candidate in law.candidates] == ["y: y"]
    assert [fault.sensor for fault in law.faults] == ["y"]
    # The readings at which the error jumps within a segment are left out.
    lost = find(convection.readings).problem.segments.seen - again.problem.segments.seen
    assert 0 < lost < 12


def test_sound_sensors_and_a_law_need_nothing_else(convection: Convection, find: Find) -> None:
    found = find(convection.readings)
    assert search_beside_errors(found) is None
    assert unexplained_force(found) is None
    left = force_beside(found, law_from_segments(found, found.best))
    assert (left.gain, left.share) == (0.0, 0.0)


def test_a_force_that_no_law_expresses_is_left(convection: Convection, find: Find) -> None:
    def tendency(t: float, u: Array) -> list[float]:
        x, y, z = u
        return [10 * (y - x), 28 * x - x * z - y, x * y - 8 / 3 * z + 40 * np.exp(-((t - 6) ** 2))]

    states = solve_ivp(tendency, (0, TIMES[-1]), [-6, -9, 21], t_eval=TIMES, rtol=1e-9).y.T
    noise = NOISE * np.random.default_rng(1).standard_normal((len(TIMES), 2))
    found = find(states[:, :2] + noise)
    force = unexplained_force(found)
    assert force is not None
    assert {cause.index for cause in force.causes} == {2}
    clean = find(convection.readings)
    left = force_beside(found, law_from_segments(clean, clean.best))
    assert left.gain > 100 and 0.1 < left.share < 1
