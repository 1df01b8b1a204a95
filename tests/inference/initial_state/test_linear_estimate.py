"""Analogs are near a recording, and their linear estimate is exact."""

from __future__ import annotations

from pathlib import Path

import pytest
import torch
from torch import Tensor

from dashred.data.observation_operator import ObservationOperator
from dashred.inference.initial_state.analogs import nearest_analogs
from dashred.inference.initial_state.linear_estimate import Estimate, leading_modes, linear_estimate
from dashred.physics.runs.ensemble import Ensemble
from dashred.physics.solvers.simulate import simulate
from dashred.physics.system import System, Term
from tests.ring import SENSORS, TIMES, ensemble, linear_system

NOISE = 0.05 * torch.ones(6, dtype=torch.float64)


@pytest.fixture
def system(tmp_path: Path) -> System:
    return linear_system(tmp_path)


def draw(*shape: int, seed: int = 0) -> Tensor:
    generator = torch.Generator().manual_seed(seed)
    return torch.randn(*shape, generator=generator, dtype=torch.float64)


def test_estimate_is_the_regression_on_the_readings() -> None:
    states, mix = draw(40, 2, 5), draw(10, 6, seed=1)
    readings = (states.flatten(1) @ mix).reshape(40, 2, 3)
    values, noise = draw(2, 3, seed=2), torch.tensor([0.3, 0.5, 1.0], dtype=torch.float64)
    values[1, 0] = torch.nan
    found = linear_estimate(states, readings, values, noise)
    known = ~values.isnan()
    u, y = states.flatten(1), readings[:, known]
    covariance = torch.cov(torch.cat([u, y], dim=1).T)
    uy, yy = covariance[:10, 10:], covariance[10:, 10:]
    gain = uy @ torch.linalg.inv(yy + torch.diag(noise.expand(2, 3)[known] ** 2))
    mean = u.mean(dim=0) + gain @ (values[known] - y.mean(dim=0))
    torch.testing.assert_close(found.mean.flatten(), mean)
    torch.testing.assert_close(
        torch.cov(found.anomalies.flatten(1).T), covariance[:10, :10] - gain @ uy.T
    )
    torch.testing.assert_close(found.anomalies.sum(dim=0), torch.zeros(2, 5).double())


def test_leading_modes_have_the_covariance() -> None:
    anomalies = draw(9, 2, 6)
    anomalies = anomalies - anomalies.mean(dim=0)
    estimate = Estimate(draw(2, 6, seed=1), anomalies)
    scale = torch.tensor([1.0, 30.0], dtype=torch.float64)
    start = leading_modes(estimate, scale, 60, 2.0)
    assert start.size == 8  # nine centred anomalies
    flat = start.modes.flatten(1)
    torch.testing.assert_close(flat.T @ flat, 4 * torch.cov(anomalies.flatten(1).T))
    fewer = leading_modes(estimate, scale, 3, 2.0)
    torch.testing.assert_close(fewer.modes, start.modes[:3])
    torch.testing.assert_close(fewer.start(torch.zeros(1, 3).double())[0], estimate.mean)


def test_a_field_that_never_differs_has_no_modes() -> None:
    anomalies = draw(9, 2, 6)
    anomalies[:, 1] = 0.0
    scale = torch.tensor([1.0, 0.0], dtype=torch.float64)
    start = leading_modes(Estimate(draw(2, 6, seed=1), anomalies), scale, 60, 1.0)
    assert start.modes.isfinite().all() and not start.modes[:, 1].any()
    assert start.modes[:, 0].any()


def test_the_analog_of_a_shifted_start_is_the_shifted_member(system: System) -> None:
    members = ensemble(system, 8)
    operator = ObservationOperator(SENSORS, system)
    truth = torch.roll(members.states[5, 12:18], 11, dims=-1)
    found = nearest_analogs(system, members, (), SENSORS, operator(truth), NOISE, 8)
    torch.testing.assert_close(found.states[0], truth[0])
    torch.testing.assert_close(found.readings[0], operator(truth))
    assert float(found.misfit[0]) < 1e-20
    assert torch.all(found.misfit.diff() >= 0)


def test_every_member_gives_an_analog_before_any_gives_two(system: System) -> None:
    members = ensemble(system, 8)
    members = Ensemble(members.times, members.states, torch.arange(8.0).double()[:, None])
    values = ObservationOperator(SENSORS, system)(members.states[3, 7:10])
    one = Term("u", system.parse("1", "library.u", equation="u"))
    found = nearest_analogs(system, members, (one,), SENSORS, values, NOISE, 12)
    counts = torch.bincount(found.coefficients[:, 0].long(), minlength=8)
    assert int(counts.min()) == 1 and int(counts.sum()) == 12
    assert int(counts.max()) == 2


@pytest.mark.parametrize(("text", "begin"), [("sin(x)", 7), ("sin(t)", 0)])
def test_states_are_not_shifted_if_the_equations_depend_on_position(
    system: System, text: str, begin: int
) -> None:
    members = ensemble(system, 8)
    operator = ObservationOperator(SENSORS, system)
    term = Term("u", system.parse(text, "library.u", equation="u"))
    moved = operator(torch.roll(members.states[3, begin : begin + 5], 11, dims=-1))
    same = operator(members.states[3, begin : begin + 5])
    # A shift is a symmetry for sin(t), and a later time is one for sin(x).
    for values, is_found in ((moved, text == "sin(t)"), (same, True)):
        found = nearest_analogs(system, members, (term,), SENSORS, values, NOISE, 4)
        assert (float(found.misfit[0]) < 1e-20) == is_found
    later = operator(members.states[3, 7:12])
    found = nearest_analogs(system, members, (term,), SENSORS, later, NOISE, 4)
    assert (float(found.misfit[0]) < 1e-20) == (text == "sin(x)")


def test_missing_values_do_not_select_analogs(system: System) -> None:
    members = ensemble(system, 8)
    values = ObservationOperator(SENSORS, system)(members.states[2, 4:9])
    wild = values.clone()
    wild[0, 1], wild[3] = torch.nan, torch.nan
    found = nearest_analogs(system, members, (), SENSORS, wild, NOISE, 1)
    torch.testing.assert_close(found.states[0], members.states[2, 4])


def test_estimate_beats_the_nearest_analog(system: System) -> None:
    operator = ObservationOperator(SENSORS, system)
    truth = ensemble(system, 1, seed=99).states[0]
    values = operator(truth[:8]) + 0.05 * draw(8, 6)
    found = nearest_analogs(system, ensemble(system, 60), (), SENSORS, values, NOISE, 60)
    estimate = linear_estimate(found.states, found.readings, values, NOISE)
    error = float((estimate.mean - truth[0]).norm())
    assert error < 0.2 * float((found.states[0] - truth[0]).norm())
    assert error / 32**0.5 < 0.05
    again = simulate(system, found.states, TIMES[:8])
    torch.testing.assert_close(operator(again), found.readings)
