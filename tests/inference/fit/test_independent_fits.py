"""Independent fits have the same bits on workers, and end in time."""

from __future__ import annotations

from dataclasses import replace
from functools import partial

import pytest
import torch

from dashred.core.budget import Deadline, OutOfTimeError
from dashred.core.cluster.calls import ClusterCalls
from dashred.inference.fit import independent_fits as module
from dashred.inference.fit.independent_fits import Fit, fit_all, fit_in_time
from dashred.inference.fit.least_squares import LeastSquaresProblem
from dashred.inference.fit.levenberg_marquardt import FitResult, minimise
from dashred.inference.forward.candidate_simulator import CandidateSimulator
from dashred.inference.forward.columns import column_blocks
from dashred.inference.forward.simulator import Simulator
from tests.waves import Waves

NAMES = ("u: u", "u: u**2")


@pytest.fixture(scope="module")
def objective(waves: Waves) -> LeastSquaresProblem:
    """A recording with a term that is missing; a simulator without windows."""
    candidates = waves.candidates(NAMES)
    recorded = waves.recorded(0.02, 1, [(candidates[1], -0.1)])
    found = waves.objective(recorded, 0.02, NAMES)
    part = CandidateSimulator(waves.system, waves.system.dt, candidates)
    model = replace(found.forward_model, simulator=Simulator([part]))
    return replace(found, forward_model=model).truncate(12)


@pytest.fixture
def workers(two_workers: ClusterCalls, monkeypatch: pytest.MonkeyPatch) -> ClusterCalls:
    """Two workers that are in use."""
    monkeypatch.setattr(module, "cluster_in_use", lambda: two_workers)
    return two_workers


def fits_of(objective: LeastSquaresProblem) -> list[Fit[FitResult]]:
    begins = 0.2 * torch.arange(3).double()[:, None].expand(3, objective.modes + len(NAMES))
    return [Fit(objective, partial(minimise, phi=phi, steps=2, tolerance=1e-3)) for phi in begins]


def test_workers_return_the_bits_of_this_machine(objective, workers, monkeypatch) -> None:
    fits = fits_of(objective)
    with torch.no_grad():
        expected = [fit() for fit in fits]
        monkeypatch.setattr(column_blocks, "LARGE", 0)
        # On this machine, no fit would run.
        monkeypatch.setattr(Fit, "__call__", lambda _: pytest.fail("runs here"))
        found = fit_all(fits)
    for mine, other in zip(found, expected, strict=True):
        assert torch.equal(mine.phi, other.phi) and torch.equal(mine.readings, other.readings)
        assert (mine.cost, mine.chi2, mine.jacobians) == (other.cost, other.chi2, other.jacobians)
    assert len({fit.cost for fit in found}) == len(fits)


@pytest.mark.parametrize("large", [False, True])
def test_fits_end_in_time(objective, workers, monkeypatch, large: bool) -> None:
    if large:
        monkeypatch.setattr(column_blocks, "LARGE", 0)
    late = replace(objective, deadline=Deadline(0.0))
    fits = fits_of(objective)[:1] + fits_of(late)[1:]
    with torch.no_grad():
        assert len(fit_in_time(fits)) == 1
        with pytest.raises(OutOfTimeError):
            fit_all(fits)


def test_small_fits_run_here(objective, workers, monkeypatch) -> None:
    monkeypatch.setattr(module, "_on_workers", lambda *_: pytest.fail("is sent"))
    with torch.no_grad():
        assert len(fit_all(fits_of(objective))) == 3
