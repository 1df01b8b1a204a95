"""An explanation near its minimum is settled there; one that has lost the recording is left."""

from __future__ import annotations

from dataclasses import replace

import pytest
import torch

from dashred.discovery.cause import LOST, Cause, settled
from dashred.discovery.gauss_newton import minimise
from dashred.discovery.law import law_of
from tests.waves import Waves

SIGMA, XI = 0.02, -0.25


def explained(waves: Waves) -> Cause:
    """Return a law, fitted to what is recorded under one of its coefficients."""
    recorded = waves.recorded(SIGMA, 1, [(waves.everything["u: u"], XI)], waves.start)
    objective = waves.objective(recorded, SIGMA, ["u: u"])
    found = minimise(objective, torch.zeros(objective.modes + 1, dtype=torch.float64), 20, 1e-6)
    candidates = objective.shooting.candidates
    return Cause(law_of(objective, found, candidates, found.cost), objective, found.phi)


def moved(cause: Cause, by: float) -> Cause:
    """Return an explanation whose fit has ended too early, its coefficient off by so much."""
    phi = cause.phi.clone()
    phi[-1] += by
    [cost], (readings, _) = cause.objective.values(phi[None])
    chi2 = float(cause.objective.residuals(readings).square().sum()) / cause.objective.noise.count
    return Cause(replace(cause.law, score=float(cost), chi2=chi2), cause.objective, phi)


def test_what_is_near_its_minimum_is_settled_there(waves: Waves) -> None:
    right = explained(waves)
    near = moved(right, 0.02)
    assert near.law.score > right.law.score + 10 and near.law.chi2 < LOST
    found = settled(near)
    assert found.law.score == pytest.approx(right.law.score, abs=0.1)
    assert float(found.phi[-1]) == pytest.approx(float(right.phi[-1]), abs=1e-3)


def test_what_has_lost_the_recording_is_left_as_it_is(waves: Waves) -> None:
    lost = moved(explained(waves), 1.0)
    assert lost.law.chi2 > LOST
    assert settled(lost) is lost
