"""A law in another unit of a field that no sensor reads is told in the plainest unit."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from dashred.data.sensors import Sensor
from dashred.inference.segments.gauss_newton import NodeFit
from dashred.inference.segments.point import Point
from dashred.inference.segments.segments import Array
from dashred.inference.segments.selection.plainer_unit import in_plainer_unit
from dashred.inference.segments.selection.rescaled_laws import RescaledLaw, rescaled_laws
from dashred.inference.segments.selection.search import PRIOR, SELECTION, SegmentSearch, weighted
from dashred.inference.segments.selection.set_selection import SegmentLaw, refit
from dashred.inference.segments.state_sensors import StateSensors
from dashred.inference.segments.weak_constraint import WeakConstraintProblem
from tests import laws
from tests.inference.segments.conftest import TEXT, Convection, Find, weak_problem

# The law of z in half of its unit: -x z and x y change in the simulator's equations.
HALVED = {"y: y": -1.0, "y: x*z": -1.0, "z: x*y": -0.5}


def rescaled(
    convection: Convection, law: Mapping[str, float], problem: WeakConstraintProblem
) -> list[RescaledLaw]:
    """Return the laws in other units of z, from a fit with z = 3 everywhere."""
    members = tuple(sorted(convection.index(name) for name in law))
    xi = np.zeros(problem.count)
    for name, value in law.items():
        xi[convection.index(name)] = value
    nodes = np.tile([1.0, 2.0, 3.0], (problem.segments.count, 1))
    point = replace(Point.at(nodes, problem.count), xi=xi)
    return list(rescaled_laws(problem, members, NodeFit(point, 1.0)))


def test_the_unit_of_the_simulator_is_found(convection: Convection) -> None:
    [law] = rescaled(convection, HALVED, weak_problem(convection))
    assert law.members == (convection.index("y: y"),)
    assert law.field == 2
    assert law.unit == pytest.approx(2.0)
    assert law.point.nodes[0].tolist() == pytest.approx([1.0, 2.0, 6.0])
    assert np.flatnonzero(law.point.xi).tolist() == list(law.members)
    assert law.point.xi[law.members[0]] == pytest.approx(-1.0)


@pytest.mark.parametrize(
    "law",
    [
        {"y: y": -1.0},
        # The unit is that of a coefficient that is nearly zero.
        {"y: y": -1.0, "y: x*z": 0.99, "z: x*y": -0.99},
        # In no unit does the law have fewer terms.
        {"y: x*z": -1.0},
        {"y: y": -1.0, "y: x*z": -1.0},
    ],
)
def test_other_laws_stay(convection: Convection, law: Mapping[str, float]) -> None:
    assert rescaled(convection, law, weak_problem(convection)) == []


def test_a_field_of_the_other_sign(convection: Convection) -> None:
    law = {"y: y": -1.0, "y: x*z": 2.0, "z: x*y": -2.0}
    [found] = rescaled(convection, law, weak_problem(convection))
    assert found.unit == -1.0 and found.members == (convection.index("y: y"),)


def test_a_small_term_without_the_field_stays(convection: Convection) -> None:
    [found] = rescaled(convection, HALVED | {"x: x": 0.3}, weak_problem(convection))
    assert found.members == tuple(sorted(convection.index(name) for name in ("x: x", "y: y")))


def test_an_equation_without_terms(convection: Convection, tmp_path: Path) -> None:
    system = laws.declared(tmp_path, TEXT.replace("x: 10*(y - x)", "x: 0"))
    empty = replace(convection, system=system)
    [found] = rescaled(empty, HALVED, weak_problem(empty))
    assert found.members == (convection.index("y: y"),)


def test_a_function_that_is_no_power_of_the_field_fixes_its_unit(convection: Convection) -> None:
    wave = laws.term(convection.system, "y", "sin(z)")
    wider = replace(convection, candidates=(*convection.candidates, wave))
    assert rescaled(wider, HALVED, weak_problem(wider))
    assert rescaled(wider, HALVED | {"y: sin(z)": 0.3}, weak_problem(wider)) == []


def test_a_field_that_a_sensor_reads_has_its_unit(convection: Convection) -> None:
    sensors = StateSensors((Sensor("x", "x"), Sensor("sum", "y + z")), convection.system)
    assert sensors.names_read == {"x", "y", "z"}
    problem = replace(weak_problem(convection), sensors=sensors)
    assert rescaled(convection, HALVED, problem) == []


def test_a_search_that_ended_in_another_unit_is_repeated(
    convection: Convection, find: Find
) -> None:
    found = find(convection.readings)
    names = [str(candidate) for candidate in found.problem.candidates]
    assert [names[j] for j in found.best.members] == ["y: y"]
    halved = in_half_unit(found, names)
    assert len(halved.best.members) == 3 and halved.best.fit.cost < 1.2 * found.best.fit.cost
    again = in_plainer_unit(halved)
    assert again.best.members == found.best.members
    true: Array = convection.states[:, 2]
    assert np.abs(again.best.fit.point.nodes[:, 2]).max() == pytest.approx(true.max(), rel=0.1)
    assert in_plainer_unit(found) is found


def test_a_smaller_law_that_leaves_more_is_not_used(
    convection: Convection, find: Find, monkeypatch: pytest.MonkeyPatch
) -> None:
    found = find(convection.readings)
    halved = in_half_unit(found, [str(candidate) for candidate in found.problem.candidates])

    def select(problem: WeakConstraintProblem, *_: object) -> list[SegmentLaw]:
        return [SegmentLaw((), replace(halved.best.fit, cost=1e6), 0.0)]

    monkeypatch.setattr("dashred.inference.segments.selection.plainer_unit.select", select)
    assert in_plainer_unit(halved) is halved


def in_half_unit(found: SegmentSearch, names: list[str]) -> SegmentSearch:
    """Return a search whose best law is that of z in half of its unit."""
    half = np.array([1.0, 1.0, 0.5])
    natural = replace(found.natural, rate=half * found.natural.rate, size=half * found.natural.size)
    problem = replace(found.problem, start_mean=half * found.problem.start_mean)
    problem = weighted(problem, natural, SELECTION, PRIOR)
    point, xi = found.best.fit.point, np.zeros(problem.count)
    for name, value in HALVED.items():
        xi[names.index(name)] = value
    members = tuple(sorted(names.index(name) for name in HALVED))
    fit = refit(problem, replace(point, nodes=half * point.nodes, xi=xi), members)
    return SegmentSearch(problem, natural, [SegmentLaw(members, fit, 0.0)])
