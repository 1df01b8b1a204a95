"""The search finds a term that a chaotic simulator leaves out, though a field is not measured."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from dashred.core.budget import Deadline
from dashred.inference.segments.findings.error_growth import error_growth
from dashred.inference.segments.findings.forecast import forecast, forecast_length, sufficient_law
from dashred.inference.segments.findings.segment_laws import law_from_segments, states_by_sample
from dashred.inference.segments.first_nodes import first_nodes
from dashred.inference.segments.gauss_newton import NodeFit, fit_nodes
from dashred.inference.segments.natural_scales import field_sizes, natural_scales
from dashred.inference.segments.point import Point
from dashred.inference.segments.segments import cut
from dashred.inference.segments.selection.equivalent_laws import merge_equivalent
from dashred.inference.segments.selection.search import (
    SegmentSearch,
    search,
    with_laws_within,
)
from dashred.inference.segments.selection.set_selection import (
    SegmentLaw,
    drop_needless,
    refit,
    refit_neighbours,
    term_price,
)
from dashred.inference.segments.steps.segment_simulator import SegmentSimulator
from tests.inference.segments.conftest import MEAN, NOISE, TIMES, Convection, Find, weak_problem


@pytest.fixture(scope="module")
def found(convection: Convection) -> SegmentSearch:
    simulator, sensors = convection.simulator, convection.sensors
    size = field_sizes(convection.segments, sensors, np.full(3, 8.0))
    guesses = first_nodes(simulator, sensors, MEAN, size)
    noise = np.full(2, NOISE)
    scales = natural_scales(simulator, sensors, convection.candidates, guesses[-1], size, noise)
    return search(weak_problem(convection), guesses, scales)


def test_the_missing_damping_is_found(convection: Convection, found: SegmentSearch) -> None:
    law = law_from_segments(found, found.best)
    assert [str(candidate) for candidate in law.candidates] == ["y: y"]
    low, high = law.interval(0)
    assert low < -1.0 < high and high - low < 0.1
    assert found.level == pytest.approx(1.0, abs=0.25)


def test_exchanging_one_candidate_leads_to_the_law(found: SegmentSearch) -> None:
    [needed], point = found.best.members, found.best.fit.point
    others = [j for j in range(found.problem.count) if j != needed]
    for pair in (tuple(others[:2]), tuple(others[-2:])):
        fits = {pair: refit(found.problem, point, pair)}
        refit_neighbours(found.problem, fits)
        best = min(fits, key=lambda members: fits[members].cost)
        assert needed in best and len(best) == 2


def test_a_better_law_within_the_library_is_taken_from_a_wider_search(
    found: SegmentSearch,
) -> None:
    poorer = replace(found, laws=[law for law in found.laws if law.members != found.best.members])
    assert poorer.best.members != found.best.members
    assert with_laws_within(poorer, found).best.members == found.best.members
    assert with_laws_within(found, found) is found
    # Candidates of the wider search alone are not taken.
    fewer = replace(poorer.problem, candidates=poorer.problem.candidates[:1])
    first = replace(
        poorer, problem=fewer, laws=[law for law in poorer.laws if set(law.members) <= {0}]
    )
    assert {law.members for law in with_laws_within(first, found).laws} <= {(), (0,)}


def test_candidates_that_are_not_needed_are_dropped_after_the_deadline(
    found: SegmentSearch,
) -> None:
    problem = replace(found.problem, deadline=Deadline(0.0))
    [needed], point = found.best.members, found.best.fit.point
    more = tuple(sorted({needed, 0, 5}))
    fits = {members: refit(found.problem, point, members) for members in ((), more)}
    drop_needless(problem, fits)
    price = term_price(problem)
    scores = {members: fit.cost + price * len(members) for members, fit in fits.items()}
    assert min(scores, key=scores.__getitem__) == (needed,)


def test_readings_without_noise_prove_no_terms_below_the_least_noise(
    convection: Convection, find: Find
) -> None:
    least = 1e-3 * NOISE
    smooth = 0.1 * least * np.sin(3 * TIMES)[:, None]
    exact = convection.states[:, :2] + smooth
    found, bare = find(exact, least_std=least), find(exact)
    assert [str(candidate) for candidate in found.terms(found.best)[0]] == ["y: y"]
    np.testing.assert_allclose(found.problem.noise_std * np.sqrt(found.level), least, rtol=1e-9)
    low, high = law_from_segments(found, found.best).interval(0)
    assert low < -1.0 < high
    assert len(bare.best.members) > 1


def test_the_unmeasured_field_is_reconstructed(
    convection: Convection, found: SegmentSearch
) -> None:
    [states] = states_by_sample(found, found.best)
    error = np.sqrt(np.square(states.numpy() - convection.states).mean(axis=0))
    assert (error < [NOISE, NOISE, 0.3]).all()


def test_an_error_of_the_start_grows_as_lyapunov_says(found: SegmentSearch) -> None:
    # The largest exponent of this model is 0.906 (Sparrow, The Lorenz equations, 1982).
    assert error_growth(found) == pytest.approx(0.906 * 12, rel=0.25)


def test_the_gradient_of_the_cost(convection: Convection) -> None:
    problem, members = weak_problem(convection), (1, 9, 12)
    rng = np.random.default_rng(3)
    nodes = convection.states[::4][: convection.segments.count] + 0.1
    point = replace(Point.at(nodes, problem.count), xi=0.05 * rng.standard_normal(problem.count))
    normal = problem.linearise(point, members)
    assert normal is not None
    assert normal.cost == pytest.approx(problem.cost(point, members))
    step, along = 1e-6, rng.standard_normal(nodes.shape)
    xi_along = np.zeros(len(point.xi))
    xi_along[list(members)] = rng.standard_normal(3)
    costs = [
        problem.cost(replace(point, nodes=nodes + s * along, xi=point.xi + s * xi_along), members)
        for s in (step, -step)
    ]
    slope = -2 * (
        np.sum(normal.node_gradient * along) + normal.shared_gradient @ xi_along[list(members)]
    )
    assert (costs[0] - costs[1]) / (2 * step) == pytest.approx(slope, rel=1e-5)


@pytest.mark.parametrize("samples", [3, 5, 9])
def test_a_record_of_one_or_two_segments(convection: Convection, samples: int) -> None:
    segments = cut([TIMES[:samples]], [convection.readings[:samples]])
    simulator = SegmentSimulator([convection.system], segments, 4)
    size = field_sizes(segments, convection.sensors, np.full(3, 8.0))
    guesses = first_nodes(simulator, convection.sensors, MEAN, size)
    chosen, noise = convection.candidates, np.full(2, NOISE)
    scales = natural_scales(simulator, convection.sensors, chosen, guesses[-1], size, noise)
    short = replace(weak_problem(convection), simulator=simulator)
    assert np.isfinite(search(short, guesses, scales).best.fit.cost)


def test_a_library_without_terms_leaves_the_empty_law(
    convection: Convection, found: SegmentSearch
) -> None:
    problem = replace(weak_problem(convection), candidates=(), prior_std=np.zeros(0))
    scales = replace(found.natural, coefficient=np.zeros(0))
    [law] = search(problem, [found.best.fit.point.nodes], scales).laws
    assert law.members == () and law.fit.cost > found.best.fit.cost


def test_equal_terms_do_not_stop_the_search(convection: Convection, found: SegmentSearch) -> None:
    damping = convection.candidates[convection.index("y: y")]
    problem = replace(weak_problem(convection), candidates=(damping, damping), prior_std=np.ones(2))
    scales = replace(found.natural, coefficient=np.ones(2))
    again = search(problem, [found.best.fit.point.nodes], scales)
    assert len(again.best.members) == 1
    assert again.best.fit.point.xi[list(again.best.members)] == pytest.approx(-1.0, abs=0.05)


def test_a_fit_that_begins_where_a_segment_blows_up_has_no_cost(convection: Convection) -> None:
    lost = Point.at(np.full((convection.segments.count, 3), 1e200), 24)
    assert fit_nodes(weak_problem(convection), lost, (), 3).cost == np.inf


def test_the_plainest_of_equivalent_laws_stays(
    convection: Convection, found: SegmentSearch
) -> None:
    damping = convection.index("y: y")
    plain = found.best
    # About zero, sin(y) is y; here a law with both stands for it, at a slightly better score.
    both = tuple(sorted((damping, convection.index("y: sin(y)"))))
    fit = NodeFit(plain.fit.point, plain.fit.cost)
    double = SegmentLaw(both, fit, plain.score - 1)
    merged = merge_equivalent(SegmentSearch(found.problem, found.natural, [double, plain]))
    assert [law.members for law in merged.laws] == [(damping,)]
    assert merged.best.score == double.score


def test_a_forecast_of_the_true_law_is_as_good_as_the_noise(found: SegmentSearch) -> None:
    length = forecast_length(found)
    assert length >= 2
    empty = next(law for law in found.laws if not law.members)
    right, wrong = (forecast(found, law, length) for law in (found.best, empty))
    assert right.rmse < 3.0 and wrong.rmse > 3 * right.rmse
    assert sufficient_law(found).members == found.best.members
