"""The true form alone, and state and law together, on recordings with a known law."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from dashred.evaluation.foreign.peers.measured import NoAnswerError
from dashred.evaluation.foreign.peers.shooting.evidence_removal import (
    PRIOR,
    largest_evidence,
    negative_log_evidence,
)
from dashred.evaluation.foreign.peers.shooting.flow import Flow
from dashred.evaluation.foreign.peers.shooting.joint_fit import JointFit
from dashred.evaluation.foreign.peers.shooting.oracle import TrueFormFit, fit_true_form
from dashred.evaluation.foreign.peers.shooting.term_removal import joint_state_and_law
from tests.evaluation.foreign.peers.recordings import damped_oscillator, lorenz


def test_the_flow_and_its_derivatives() -> None:
    given = lorenz()
    flow = Flow(given.system, given.library, given.scale, steps=4)
    states, times = given.readings[::40], given.times[::40]
    coefficients = np.zeros(len(given.library))
    coefficients[[1, 5]] = 0.3, -1.0
    moved = flow(states, times, coefficients, 0.025)
    rows = np.tile(coefficients, (len(states), 1))
    np.testing.assert_allclose(moved.states, flow.advance(states, times, rows, 0.025))
    for k, change in enumerate(np.eye(3) * 1e-4):
        ends = [flow(states + s * change, times, coefficients, 0.025).states for s in (1, -1)]
        found = (ends[0] - ends[1]) / 2e-4
        np.testing.assert_allclose(moved.by_start[:, :, k], found, rtol=1e-3, atol=1e-4)
    for j, change in enumerate(np.eye(len(coefficients)) * 1e-4):
        ends = [flow(states, times, coefficients + s * change, 0.025).states for s in (1, -1)]
        found = (ends[0] - ends[1]) / 2e-4
        np.testing.assert_allclose(moved.by_coefficients[:, :, j], found, rtol=1e-3, atol=1e-4)


def test_a_step_of_the_joint_fit_solves_the_normal_equations() -> None:
    """The derivatives of the cost by differences, and the step by a dense solution."""
    given = damped_oscillator("x")
    given = replace(given, times=given.times[:6], readings=given.readings[:6])
    fit = JointFit(given, given.library)
    states, coefficients = given.first_states, np.full(len(given.library), 0.1)
    point = fit.at(states, coefficients, 0.1)
    assert point is not None
    for k in range(states.size):
        change = 1e-5 * np.eye(states.size)[k].reshape(states.shape)
        ends = [fit.at(states + s * change, coefficients, 0.1) for s in (1, -1)]
        costs = [end.cost for end in ends if end is not None]
        slope = (costs[0] - costs[1]) / 2e-5
        assert -2 * point.slope_states[k] == pytest.approx(slope, rel=1e-4, abs=1e-2)
    size, band = states.size, len(point.banded)
    dense = np.zeros((size, size))
    for below in range(band):
        for column in range(size - below):
            dense[column + below, column] = dense[column, column + below] = point.banded[
                below, column
            ]
    whole = np.block([[dense, point.mixed], [point.mixed.T, point.own]])
    whole[np.diag_indices_from(whole)] *= 1.5
    right = np.concatenate([point.slope_states, point.slope_coefficients])
    expected = np.linalg.solve(whole, right)
    by_states, by_coefficients = point.step(0.5)
    np.testing.assert_allclose(by_states.ravel(), expected[:size], rtol=1e-6, atol=1e-9)
    np.testing.assert_allclose(by_coefficients, expected[size:], rtol=1e-6, atol=1e-9)


@pytest.mark.parametrize("measured", ["xv", "v"])
def test_the_damping_of_an_oscillator_is_found_with_its_state(measured: str) -> None:
    [term] = joint_state_and_law(damped_oscillator(measured))
    assert (term["equation"], term["term"]) == ("v", "v")
    assert term["coefficient"] == pytest.approx(-0.3, rel=0.05)


def test_the_criterion_may_keep_a_small_term_by_chance() -> None:
    """It has no allowance for the number of candidates: a limit of the method."""
    law = {
        term["term"]: term["coefficient"] for term in joint_state_and_law(damped_oscillator("x"))
    }
    assert law.pop("v") == pytest.approx(-0.3, rel=0.05)
    assert all(abs(coefficient) < 0.05 for coefficient in law.values())


@pytest.mark.parametrize("measured", ["xyz", "xz"])
def test_the_term_of_a_chaotic_system_is_found_with_its_state(measured: str) -> None:
    [term] = joint_state_and_law(lorenz(measured))
    assert (term["equation"], term["term"]) == ("y", "x*z")
    assert term["coefficient"] == pytest.approx(-1.0, rel=0.01)


def test_nothing_is_found_where_nothing_is_missing() -> None:
    given = damped_oscillator()
    whole = given.system.with_terms([(given.library[2], -0.3)])
    assert joint_state_and_law(replace(given, system=whole)) == []


def test_a_law_outside_of_the_library_is_no_answer() -> None:
    given = damped_oscillator()
    with pytest.raises(NoAnswerError, match="times the variance of the noise"):
        joint_state_and_law(replace(given, library=given.library[:1]))


@pytest.mark.parametrize("measured", ["xyz", "x", "z"])
def test_the_true_form_is_fitted_to_a_chaotic_system(measured: str) -> None:
    given = lorenz(measured)
    form = [term for term in given.library if str(term) == "x*z"]
    [term] = fit_true_form(given, form)
    assert (term["equation"], term["term"]) == ("y", "x*z")
    assert term["coefficient"] == pytest.approx(-1.0, rel=0.01)


def test_a_form_that_is_not_true_is_no_answer() -> None:
    given = damped_oscillator()
    with pytest.raises(NoAnswerError, match="times the variance of the noise"):
        fit_true_form(given, [given.library[3]])


def test_the_derivatives_of_the_multiple_shooting() -> None:
    given = lorenz("xz")
    fit = TrueFormFit(given, [term for term in given.library if str(term) in ("x*z", "z")])
    x = np.concatenate([[0.1, -0.9], given.first_states[:24:8].ravel()])
    derivatives = fit._jacobian(x)
    for k, change in enumerate(np.eye(len(x)) * 1e-5):
        found = (fit._residuals(x + change) - fit._residuals(x - change)) / 2e-5
        size = np.abs(found).max()
        np.testing.assert_allclose(derivatives[:, k], found, rtol=1e-3, atol=1e-4 * size)


def test_the_evidence_leaves_the_true_terms_alone() -> None:
    [term] = largest_evidence(damped_oscillator("xv"))
    assert (term["equation"], term["term"]) == ("v", "v")
    assert term["coefficient"] == pytest.approx(-0.3, rel=0.05)


def test_the_evidence_of_a_linear_fit_is_that_of_the_closed_form() -> None:
    given = damped_oscillator("xv")
    fit = JointFit(given, given.library)
    point = fit.at(given.first_states, np.zeros(len(given.library)), 0.1)
    assert point is not None
    information = point.information() + np.eye(len(given.library)) / PRIOR**2
    expected = point.cost / 2 + np.linalg.slogdet(information)[1] / 2
    expected += len(given.library) * math.log(PRIOR)
    assert negative_log_evidence(point) == pytest.approx(expected)
    without = replace(
        point,
        coefficients=point.coefficients[:0],
        mixed=point.mixed[:, :0],
        own=point.own[:0, :0],
        slope_coefficients=point.slope_coefficients[:0],
    )
    assert negative_log_evidence(without) == pytest.approx(point.cost / 2)
