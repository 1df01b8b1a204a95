"""Forces and sensor errors that walk: their derivatives, and the evidence of a linear problem."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from dashred.core.numerics.block_tridiagonal import BlockNormal
from dashred.data.sensors import Sensor
from dashred.inference.segments.point import Point
from dashred.inference.segments.segments import Array, cut
from dashred.inference.segments.state_sensors import StateSensors
from dashred.inference.segments.steps.segment_simulator import SegmentSimulator
from dashred.inference.segments.walks import Walks
from dashred.inference.segments.weak_constraint import WeakConstraintProblem
from tests import laws
from tests.inference.segments.conftest import Convection, weak_problem

WALKS = Walks((2,), (1,), np.array([30.0, 2.0, 1.0]), np.array([5.0, 0.3, 0.4]))
DECAY = """
system:
  title: decay
  fields: {x: amount}
  equations: {x: -0.4*x}
  start: {x: 1}
  spread: {x: 1}
  integrator: {method: rk4, dt: 0.25}
recording: {twin: a, sensors: 1, noise: 0, duration: 4, every: 0.25}
"""


def test_the_gradient_of_the_cost_with_walks(convection: Convection) -> None:
    problem, members = replace(weak_problem(convection), walks=WALKS), (1, 9, 12)
    rng = np.random.default_rng(3)
    nodes = convection.states[::4][: convection.segments.count] + 0.1
    point = Point(
        nodes, 0.05 * rng.standard_normal(problem.count), rng.standard_normal((len(nodes), 3))
    )
    normal = problem.linearise(point, members)
    assert normal is not None
    assert normal.cost == pytest.approx(problem.cost(point, members))
    along, xi_along = rng.standard_normal((len(nodes), 6)), rng.standard_normal(3)
    costs = [
        problem.cost(point.moved(s * along, members, s * xi_along), members) for s in (1e-6, -1e-6)
    ]
    slope = -2 * (np.sum(normal.node_gradient * along) + normal.shared_gradient @ xi_along)
    assert (costs[0] - costs[1]) / 2e-6 == pytest.approx(slope, rel=1e-5)


@pytest.fixture(scope="module")
def decay(tmp_path_factory: pytest.TempPathFactory) -> WeakConstraintProblem:
    """A linear problem with a steady sensor of x in two episodes."""
    system = laws.declared(tmp_path_factory.mktemp("decay"), DECAY)
    clocks = [np.arange(0, 4.1, 0.25), np.arange(0, 2.1, 0.25)]
    rng = np.random.default_rng(1)
    readings = [rng.standard_normal((len(clock), 1)) for clock in clocks]
    return WeakConstraintProblem(
        simulator=SegmentSimulator([system, system], cut(clocks, readings), 2),
        sensors=StateSensors((Sensor("x", "x"),), system),
        candidates=(laws.term(system, "x", "x"),),
        noise_std=np.array([0.3]),
        model_error=np.array([0.2]),
        start_mean=np.array([[0.5], [-0.5]]),
        start_std=np.array([0.7]),
        prior_std=np.ones(1),
    )


def at_zero(problem: WeakConstraintProblem) -> Point:
    count = problem.segments.count
    return Point(np.zeros((count, 1)), np.zeros(1), np.zeros((count, problem.walks.count)))


def whole(normal: BlockNormal) -> Array:
    """Return A as one matrix."""
    nodes, width = normal.node_gradient.shape
    found = np.zeros((nodes, width, nodes, width))
    for k in range(nodes):
        found[k, :, k] = normal.diagonal[k]
        if k + 1 < nodes:
            found[k, :, k + 1], found[k + 1, :, k] = normal.upper[k], normal.upper[k].T
    return found.reshape(nodes * width, nodes * width)


@pytest.mark.parametrize(
    "walks",
    [
        Walks((0,), (), np.array([0.5]), np.array([0.2])),
        Walks((), (0,), np.array([0.5, 0.3]), np.array([0.2, 0.1])),
        Walks((0,), (0,), np.array([0.5, 0.4, 0.3]), np.array([0.2, 0.1, 0.3])),
    ],
)
def test_the_evidence_of_a_linear_problem_is_its_marginal_likelihood(
    decay: WeakConstraintProblem, walks: Walks
) -> None:
    # The readings are normal: their covariance follows from samples of the prior, column by column.
    problem = replace(decay, walks=walks)
    point = at_zero(problem)
    normal, found = problem.linearise(point, ()), problem.derivatives(point, ())
    assert normal is not None and found is not None
    width, count = found.ahead.shape[1], problem.segments.count
    # Without readings, A is the prior precision of the whole chain.
    unseen = replace(problem, noise_std=np.array([1e9])).normal_equations(found, point, ())
    prior = whole(unseen)
    slopes = np.zeros((count, found.readings.shape[1], count, width))
    slopes[np.arange(count), :, np.arange(count)] = found.readings[:, :, 0]
    rows = problem.segments.available[..., 0].ravel()
    slopes = slopes.reshape(-1, count * width)[rows]
    mean = slopes @ np.linalg.solve(prior, unseen.node_gradient.ravel())
    covariance = slopes @ np.linalg.solve(prior, slopes.T) + 0.09 * np.eye(len(slopes))
    apart = problem.segments.readings[..., 0].ravel()[rows] - mean
    exact = apart @ np.linalg.solve(covariance, apart) + np.linalg.slogdet(covariance)[1]
    volume, least = normal.log_determinant(), normal.minimum()
    assert volume is not None and least is not None
    told = least + volume + len(slopes) * np.log(0.09) - np.linalg.slogdet(prior)[1]
    assert told == pytest.approx(exact, rel=1e-6)
    # The prior precision of the walks is what the problem without walks lacks.
    bare = replace(decay, noise_std=np.array([1e9])).linearise(at_zero(decay), ())
    assert bare is not None
    log_prior = np.linalg.slogdet(whole(bare))[1] - np.linalg.slogdet(prior)[1]
    assert walks.log_prior_variance(problem.segments) == pytest.approx(log_prior, rel=1e-6)


def test_the_covariance_of_a_walk(decay: WeakConstraintProblem) -> None:
    problem = replace(decay, walks=Walks((), (0,), np.array([0.5, 0.3]), np.array([0.2, 0.1])))
    normal = problem.linearise(at_zero(problem), (0,))
    assert normal is not None
    inner = whole(normal)
    border = normal.border.reshape(len(inner), -1)
    joint = np.block([[inner, border], [border.T, normal.corner]])
    blocks = np.linalg.inv(joint)[: len(inner), : len(inner)]
    blocks = blocks.reshape(problem.segments.count, 3, problem.segments.count, 3)
    expected = np.einsum("kikj->kij", blocks)[:, 1:, 1:]
    found = normal.covariance([1, 2])
    assert found is not None
    np.testing.assert_allclose(found, expected, rtol=1e-8, atol=1e-12)


def test_an_error_is_a_value_and_a_slope(decay: WeakConstraintProblem) -> None:
    walks = Walks((), (0,), np.ones(2), np.ones(2))
    segments = decay.segments
    walked = np.stack([np.arange(segments.count), 2.0 * np.ones(segments.count)], axis=1)
    found = walks.errors(segments, walked)
    since = segments.times - segments.times[:, :1]
    np.testing.assert_allclose(
        np.asarray(found)[..., 0], np.arange(segments.count)[:, None] + 2 * since
    )
