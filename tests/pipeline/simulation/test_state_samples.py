"""Terms get their scales where the simulation is within the range of the recording."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch

from dashred.inference.forward.candidates import build_candidates
from dashred.pipeline.problem import Problem
from dashred.pipeline.simulation.nominal_run import NominalRun
from dashred.pipeline.simulation.reading_range import distance_from_readings
from dashred.pipeline.simulation.state_samples import FARTHEST, state_samples
from tests.pipeline.simulation.conftest import runs_without

SYSTEM = """
system:
  title: growth with diffusion
  axes: {x: {length: 10, points: 32}}
  fields: {u: amount}
  equations: {u: 0.1*lap(u) + 0.6*uMISSING}
  start: {u: 0.2 + 0.15*cos(2*pi*x/10)}
  spread: {u: 0.02}
  integrator: {dt: 0.02}
"""
TIMES = torch.linspace(0, 4, 61, dtype=torch.float64)


@pytest.fixture(scope="module")
def runs(tmp_path_factory: pytest.TempPathFactory) -> tuple[Problem, NominalRun]:
    """A simulator without its saturation, whose run drifts away from the recording."""
    folder = tmp_path_factory.mktemp("runs")
    return runs_without(" - u**3", SYSTEM, (0.2, 0.15), TIMES, folder)


def test_samples_within_the_range_of_the_recording_are_kept(
    runs: tuple[Problem, NominalRun],
) -> None:
    problem, nominal = runs
    away = distance_from_readings(problem, nominal.states)
    samples = state_samples(problem, nominal)
    assert 20 <= len(samples.times) < len(nominal.states)
    assert torch.equal(samples.times, problem.times[away < FARTHEST])
    assert torch.equal(samples.states, nominal.states[away < FARTHEST])


def test_the_scale_of_a_saturation_admits_its_coefficient(
    runs: tuple[Problem, NominalRun],
) -> None:
    problem, nominal = runs
    samples = state_samples(problem, nominal)
    found = {
        name: next(
            candidate.scale
            for candidate in build_candidates(problem.system, problem.library, states, times)
            if str(candidate) == "u: u**3"
        )
        for name, states, times in (
            ("within", samples.states, samples.times),
            ("everywhere", nominal.states, problem.times),
        )
    }
    assert found["within"] > 0.5 and found["everywhere"] < 0.25


def test_a_run_that_is_not_finite_is_infinitely_far(runs: tuple[Problem, NominalRun]) -> None:
    problem, nominal = runs
    states = nominal.states.clone()
    states[-1, 0, 3] = torch.nan
    assert distance_from_readings(problem, states)[-1] == torch.inf


def with_readings(problem: Problem, values: np.ndarray) -> Problem:
    """The problem with other readings of its fitted sensors."""
    fit = replace(problem.split.fit, values=values)
    return replace(problem, split=replace(problem.split, fit=fit))


def test_missing_readings_have_no_influence(runs: tuple[Problem, NominalRun]) -> None:
    problem, nominal = runs
    values = problem.split.fit.values.copy()
    values[::3, 0] = np.nan
    away = distance_from_readings(with_readings(problem, values), nominal.states)
    torch.testing.assert_close(
        away, distance_from_readings(problem, nominal.states), rtol=0.1, atol=0.1
    )


def test_a_quantity_that_is_constant_has_the_range_of_its_noise(
    runs: tuple[Problem, NominalRun],
) -> None:
    problem, nominal = runs
    still = with_readings(problem, np.ones_like(problem.split.fit.values))
    noise = float(still.fit_noise_std().max())
    states = torch.ones_like(nominal.states) + 3 * noise
    away = distance_from_readings(still, states)
    torch.testing.assert_close(away, torch.full_like(away, 3.0))


def test_a_rare_pulse_that_was_recorded_is_within_the_range(
    runs: tuple[Problem, NominalRun],
) -> None:
    problem, nominal = runs
    values = np.zeros_like(problem.split.fit.values)
    values[3] = 10.0
    pulsed = with_readings(problem, values)
    away = distance_from_readings(pulsed, torch.full_like(nominal.states, 9.9))
    # The pulse is far from the mean.
    assert (9.9 - values.mean()) / values.std() > FARTHEST and not away.any()
    assert (distance_from_readings(pulsed, torch.full_like(nominal.states, 30.0)) > FARTHEST).all()
    # A single spike of a sensor is no pulse.
    values[3, 1:] = 0.0
    spiked = with_readings(problem, values)
    assert (distance_from_readings(spiked, torch.full_like(nominal.states, 9.9)) > FARTHEST).all()
