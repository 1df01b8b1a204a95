"""A first guess that is too sure of itself bends the law to its start: the prior puts it right."""

from __future__ import annotations

from dataclasses import replace

import pytest
import torch

from dashred.inference.fit.least_squares import LeastSquaresProblem
from dashred.inference.fit.levenberg_marquardt import minimise
from dashred.inference.fit.selection.stepwise_selection import Selection, select
from dashred.inference.forward.episodes import EpisodeStarts
from dashred.inference.initial_state.start_models import LinearStart, StartModel
from dashred.pipeline.discovery.prior_start import fit_near_prior, select_near_prior
from tests.swing import Swing, noisy

SIGMA = 0.02
NAMES = ("k", "c", "x**2", "x**3", "p**3", "sign(p)", "x*p")
TRUE = (NAMES.index("x**3"),)


def silent(_: float, __: str) -> None:
    """Report nothing."""


@pytest.fixture(scope="module")
def swing(tmp_path_factory: pytest.TempPathFactory) -> Swing:
    return Swing.declared(tmp_path_factory.mktemp("swing"))


def make_objective(swing: Swing, z: tuple[float, float], start: StartModel) -> LeastSquaresProblem:
    recorded = noisy(swing.clean(z, ["x**3"], [-0.3]), SIGMA, 3)
    return swing.objective(NAMES, recorded, SIGMA, 1.0).with_start(start)


def guess(swing: Swing, z: tuple[float, float], off: tuple[float, float], std: float) -> StartModel:
    """Return a first guess about a start that is off."""
    [true] = swing.estimate.start(torch.tensor([z], dtype=torch.float64))
    about = LinearStart(true + torch.tensor(off), std * torch.eye(2, dtype=torch.float64))
    return EpisodeStarts((about,))


def searched(objective: LeastSquaresProblem) -> Selection:
    tight = replace(objective, prior_std=0.05 * objective.prior_std)
    zero = torch.zeros(objective.modes + len(NAMES), dtype=torch.float64)
    return select(objective, minimise(tight, zero, 6, 1e-3).phi, [TRUE], silent)


def test_a_law_that_was_bent_to_a_first_guess_is_put_right(swing: Swing) -> None:
    z = (0.8, -0.6)
    bent = searched(make_objective(swing, z, guess(swing, z, (0.04, 0.06), 0.002)))
    assert bent.tried[0].members != TRUE
    found = select_near_prior(swing.start, bent, 6, silent)
    assert found.objective.forward_model.start is swing.start
    assert found.tried[0].members == TRUE and found.exhausted
    assert float(found.tried[0].phi[2 + TRUE[0]]) == pytest.approx(-0.3, abs=0.02)


def test_a_start_outside_of_the_prior_stays_with_its_first_guess(swing: Swing) -> None:
    z = (0.8, -0.6)
    told = searched(make_objective(swing, z, guess(swing, z, (0.0, 0.0), 0.1)))
    assert told.tried[0].members == TRUE
    far_off = LinearStart(swing.estimate.mean - 3.0, 0.1 * swing.estimate.modes)
    elsewhere = EpisodeStarts((far_off,))
    assert select_near_prior(elsewhere, told, 6, silent) is told


def test_of_a_fit_about_the_prior_nothing_more_is_asked(swing: Swing) -> None:
    law = make_objective(swing, (0.8, -0.6), swing.start).subset(TRUE)
    phi = torch.zeros(law.modes + 1, dtype=torch.float64)
    assert fit_near_prior(swing.start, law, phi) is None


def test_the_same_start_is_found_about_the_prior(swing: Swing) -> None:
    z = (0.8, -0.6)
    law = make_objective(swing, z, guess(swing, z, (0.02, -0.05), 0.1)).subset(TRUE)
    fitted = minimise(law, torch.zeros(law.modes + 1, dtype=torch.float64), 10, 1e-6)
    found = fit_near_prior(swing.start, law, fitted.phi)
    assert found is not None
    mine, again = found
    assert mine.forward_model.start is swing.start
    torch.testing.assert_close(again.phi[:2], torch.tensor(z).double(), atol=0.05, rtol=0)
    assert again.chi2 < 1.05 * fitted.chi2
