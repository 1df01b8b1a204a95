"""Uncertain parameters over segments: their derivatives, and a posterior that is known exactly."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from dashred.data.sensors import Sensor
from dashred.inference.forward.candidates import ChangePrior
from dashred.inference.forward.parameter_block import ParameterBlock
from dashred.inference.segments.findings.segment_laws import law_from_segments
from dashred.inference.segments.gauss_newton import fit_nodes
from dashred.inference.segments.natural_scales import NaturalScales
from dashred.inference.segments.point import Point
from dashred.inference.segments.segments import cut
from dashred.inference.segments.selection.candidate_sets import profile
from dashred.inference.segments.selection.search import SegmentSearch, weighted
from dashred.inference.segments.selection.set_selection import SegmentLaw
from dashred.inference.segments.state_sensors import StateSensors
from dashred.inference.segments.steps.segment_simulator import SegmentSimulator
from dashred.inference.segments.weak_constraint import WeakConstraintProblem
from tests import laws

TEXT = """
system:
  title: growth at a steady rate
  fields: {x: amount}
  parameters: {c: 0.4, k: 0.1}
  equations: {x: c - k*x}
  start: {x: 1}
  spread: {x: 1}
  integrator: {method: rk4, dt: 0.25}
recording: {twin: a, sensors: 1, noise: 0, duration: 4, every: 0.25}
"""
TIMES = np.linspace(0, 4, 17)
SIGMA, SPREAD, MEAN = 0.05, 0.3, -0.1


@pytest.fixture(scope="module")
def problem(tmp_path_factory: pytest.TempPathFactory) -> WeakConstraintProblem:
    """A problem with c uncertain, and a term and k as candidates."""
    system = laws.declared(tmp_path_factory.mktemp("growth"), TEXT)
    uncertain = replace(laws.parameter(system, "c"), prior=ChangePrior(MEAN, SPREAD))
    noise = SIGMA * np.random.default_rng(2).standard_normal(len(TIMES))
    return WeakConstraintProblem(
        simulator=SegmentSimulator([system], cut([TIMES], [(1 + 0.7 * TIMES + noise)[:, None]]), 2),
        sensors=StateSensors((Sensor("x", "x"),), system),
        candidates=(laws.term(system, "x", "x**2"), laws.parameter(system, "k")),
        noise_std=np.array([SIGMA]),
        model_error=np.array([1e-6]),
        start_mean=np.array([[0.8]]),
        start_std=np.array([0.5]),
        prior_std=np.ones(2),
        parameters=ParameterBlock((uncertain,)),
    )


def begin(problem: WeakConstraintProblem) -> Point:
    nodes = 1 + 0.6 * problem.segments.times[:, :1]
    return replace(Point.at(nodes, 2, np.array([0.2])), xi=np.array([0.02, 0.05]))


def test_the_gradient_of_the_cost(problem: WeakConstraintProblem) -> None:
    rng, point, members = np.random.default_rng(3), begin(problem), (0, 1)
    loose = problem.with_weights(np.array([0.1]), problem.prior_std)
    normal = loose.linearise(point, members)
    assert normal is not None and len(normal.shared_gradient) == 3
    along, shared = rng.standard_normal(point.nodes.shape), rng.standard_normal(3)
    costs = [
        loose.cost(point.moved(s * along, members, s * shared), members) for s in (1e-6, -1e-6)
    ]
    slope = -2 * (np.sum(normal.node_gradient * along) + normal.shared_gradient @ shared)
    assert (costs[0] - costs[1]) / 2e-6 == pytest.approx(slope, rel=1e-5)


def test_sets_are_compared_with_the_parameters_at_their_best(
    problem: WeakConstraintProblem,
) -> None:
    point = begin(problem)
    profiled = profile(problem, point)
    assert profiled is not None
    for members in ((), (0,), (1,), (0, 1)):
        # The problem is linear in the unknowns of a set only about coefficients that are zero.
        [cost] = profiled.costs([members]).tolist()
        normal = problem.linearise(point, (0, 1))
        assert normal is not None
        gram, target, constant = normal.profiled() or pytest.fail()
        chosen = [*members, 2]
        fixed = [j for j in range(2) if j not in members]
        away = np.zeros(3)
        away[fixed] = -point.xi[fixed]
        base = constant - 2 * target @ away + away @ gram @ away
        rest = (target - gram @ away)[chosen]
        least = base - rest @ np.linalg.solve(gram[np.ix_(chosen, chosen)], rest)
        assert cost == pytest.approx(least, rel=1e-8)


def test_the_posterior_of_a_linear_problem(problem: WeakConstraintProblem) -> None:
    """With ``x' = c`` the readings are linear in the start and in c."""
    still = problem.simulator.systems[0]
    parameters = still.config.parameters | {"k": 0.0}
    system = still.with_config(replace(still.config, parameters=parameters))
    linear = replace(
        problem,
        simulator=SegmentSimulator([system], problem.segments, 2),
        candidates=(),
        prior_std=np.zeros(0),
    )
    start = Point.at(begin(problem).nodes, 0, np.array([MEAN]))
    fit = fit_nodes(linear, start, (), 20, 1e-12)
    scales = NaturalScales(np.ones(1), np.ones(1), np.zeros(0))
    search = SegmentSearch(linear, scales, [SegmentLaw((), fit, fit.cost)])
    law = law_from_segments(search, search.best)
    [found] = law.parameters
    design = np.stack([np.ones_like(TIMES), TIMES], axis=1)
    precision = design.T @ design / SIGMA**2 + np.diag([0.5**-2, SPREAD**-2])
    readings = problem.segments.join(problem.segments.readings, 0)[:, 0] - 0.4 * TIMES
    right = design.T @ readings / SIGMA**2 + np.array([0.8 / 0.25, MEAN / SPREAD**2])
    assert found.candidate.name == "c" and law.candidates == ()
    # The model error is small, but not zero.
    assert found.change == pytest.approx(np.linalg.solve(precision, right)[1], rel=1e-3)
    std = np.sqrt(search.level * np.linalg.inv(precision)[1, 1])
    assert found.std == pytest.approx(std, rel=1e-3)


def test_without_readings_a_parameter_stays_as_stated(problem: WeakConstraintProblem) -> None:
    segments = problem.segments
    unseen = replace(segments, readings=np.full_like(segments.readings, np.nan))
    blind = replace(problem, simulator=problem.simulator.with_segments(unseen))
    loose = blind.with_weights(np.array([0.01]), problem.prior_std)
    fit = fit_nodes(loose, begin(problem), (), 20, 1e-12)
    assert fit.point.parameters == pytest.approx(MEAN, abs=1e-4)


def test_a_parameter_changes_by_less_than_a_term(problem: WeakConstraintProblem) -> None:
    one = np.ones(1)
    priors = [
        weighted(problem, NaturalScales(one, one, np.full(2, scale)), 0.1, 3.0).prior_std
        for scale in (0.01, 0.05, 0.2)
    ]
    # The candidates are a term, and k = 0.1.
    np.testing.assert_allclose(priors, [[0.03, 0.03], [0.15, 0.1], [0.6, 0.2]])
