"""A simulator that lacks its dissipation is not resolved; smooth states along the readings are."""

from __future__ import annotations

from dataclasses import replace

import pytest
import torch

from dashred.core.budget import Budget
from dashred.physics.runs.resolution import Resolution
from dashred.pipeline.problem import Problem
from dashred.pipeline.simulation.nominal_run import (
    NominalRun,
    can_be_corrected,
    corrected_towards_readings,
)
from dashred.pipeline.simulation.resolution_check import check_discretisation
from dashred.pipeline.simulation_runs import _along_readings
from dashred.pipeline.verification.verification import unresolved_findings
from tests.pipeline.simulation.conftest import runs_without

SYSTEM = """
system:
  title: steepening waves
  axes: {x: {length: 10, points: 48}}
  fields: {u: velocity}
  equations: {u: -u*d(u, x)MISSING}
  start: {u: 1 + 0.6*cos(2*pi*x/10)}
  spread: {u: 0.02}
  integrator: {dt: 0.01}
"""
TIMES = torch.linspace(0, 8, 81, dtype=torch.float64)


@pytest.fixture(scope="module")
def runs(tmp_path_factory: pytest.TempPathFactory) -> tuple[Problem, NominalRun]:
    """The simulator without its viscosity, in which shocks form, beside a recording."""
    folder = tmp_path_factory.mktemp("runs")
    return runs_without(" + 0.2*lap(u)", SYSTEM, (1.0, 0.6), TIMES, folder)


def test_its_own_run_is_not_resolved_and_smooth_states_are(
    runs: tuple[Problem, NominalRun],
) -> None:
    problem, nominal = runs
    own = check_discretisation(problem, nominal, {})
    assert not own.resolved and own.enough is None
    along = corrected_towards_readings(problem, nominal, {})
    assert can_be_corrected(problem, nominal) and not can_be_corrected(problem, along)
    found = check_discretisation(problem, along, {})
    assert found.resolved and found.is_early


def test_smooth_states_follow_the_readings(runs: tuple[Problem, NominalRun]) -> None:
    problem, nominal = runs
    along = corrected_towards_readings(problem, nominal, {})
    [states] = along.restarted
    assert states.shape == nominal.states.shape
    fit = problem.split.fit
    apart = problem.operator(fit)(states[: len(fit.times)]).numpy() - fit.values
    assert (apart**2).mean() ** 0.5 < 0.1 * fit.values.std()
    waves = torch.fft.rfft(states[:, 0]).abs()
    kept = len(nominal.prior.basis)
    assert float(waves[:, kept:].max()) < 1e-9 * float(waves.max())


def test_without_time_for_them_the_run_stays_as_it_is(runs: tuple[Problem, NominalRun]) -> None:
    problem, nominal = runs
    hurried = replace(problem, budget=Budget.begin(1e-6))
    own = Resolution(1.0, 0.01, None)
    found = _along_readings(hurried, nominal, own, {})
    assert found == (nominal, own)
    assert hurried.budget.not_tried == ["smooth states along the readings"]
    findings = unresolved_findings(hurried, own)
    assert findings["budget"] is not None
