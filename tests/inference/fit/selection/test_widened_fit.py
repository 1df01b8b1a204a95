"""Fits with a prior that the evidence widens."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest
import torch
from torch import Tensor

from dashred.inference.fit.least_squares import LeastSquaresProblem
from dashred.inference.fit.levenberg_marquardt import minimise
from dashred.inference.fit.selection.widened_fit import fit_widened
from tests.swing import FORCES, Swing, noisy

SIGMA, TIGHT, FORCE = 0.05, 0.05, -3.0
SAMPLES, STEPS, TOLERANCE = 20, 6, 0.02
Z = (0.8, -0.6)


@pytest.fixture(scope="module")
def objective(swing: Swing) -> LeastSquaresProblem:
    """The first samples of a recording with a strong force."""
    recorded = noisy(swing.clean(Z, ("x**3",), (FORCE,)), SIGMA, seed=0)
    return swing.objective(FORCES, recorded, SIGMA, TIGHT).truncate(SAMPLES)


def narrow_fit(objective: LeastSquaresProblem) -> Tensor:
    begin = torch.zeros(objective.modes + len(objective.prior_std), dtype=torch.float64)
    return minimise(objective, begin, STEPS, TOLERANCE).phi


def test_a_strong_force_gets_a_wide_prior(objective: LeastSquaresProblem) -> None:
    phi, narrow = narrow_fit(objective), objective.prior_std
    found, jacobians = fit_widened(objective, narrow, phi, STEPS, TOLERANCE)
    assert found is not None and jacobians >= 2
    wide = [FORCES[j] for j in torch.nonzero(found.prior_std > narrow).flatten().tolist()]
    assert wide == ["x**3"]
    value = float(found.fitted.phi[objective.modes + FORCES.index("x**3")])
    assert value == pytest.approx(FORCE, rel=0.1)
    assert found.fitted.chi2 / objective.noise.count < 1.3
    assert found.cost > found.fitted.cost


def test_a_prior_that_suffices_stays(objective: LeastSquaresProblem, swing: Swing) -> None:
    recorded = noisy(swing.clean(Z, (), ()), SIGMA, seed=0)
    quiet = replace(objective, recorded=recorded[:SAMPLES])
    found, jacobians = fit_widened(quiet, quiet.prior_std, narrow_fit(quiet), STEPS, TOLERANCE)
    assert found is None and jacobians == 1


def test_without_candidates_there_is_nothing_to_widen(objective: LeastSquaresProblem) -> None:
    empty = objective.subset(())
    phi = torch.zeros(empty.modes, dtype=torch.float64)
    assert fit_widened(empty, empty.prior_std, phi, STEPS, TOLERANCE) == (None, 0)


def test_no_prior_is_widened_where_the_run_blows_up(objective: LeastSquaresProblem) -> None:
    phi = narrow_fit(objective)
    phi[objective.modes + FORCES.index("x**3")] = 1e3
    found, _ = fit_widened(objective, objective.prior_std, phi, STEPS, TOLERANCE)
    assert found is None or math.isfinite(found.fitted.cost)
