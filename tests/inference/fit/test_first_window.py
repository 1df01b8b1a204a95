"""The first window is short, and its fit finds a distant start."""

from __future__ import annotations

from dataclasses import replace

import torch

from dashred.core.budget import Deadline
from dashred.inference.fit.first_window import SAMPLES, first_samples, fit_first_window
from dashred.inference.fit.least_squares import LeastSquaresProblem
from dashred.inference.fit.levenberg_marquardt import minimise
from dashred.inference.forward.episodes import EpisodeStarts
from dashred.inference.initial_state.start_models import LinearStart
from tests.swing import Swing, noisy

SIGMA = 0.05


def test_the_first_window_is_short_for_any_number_of_modes(swing: Swing) -> None:
    """With few sensors, a reading per mode would need too long a stretch of chaos."""
    recorded = noisy(swing.clean((0.8, -0.6), (), ()), SIGMA, seed=0)
    objective = swing.objective(("k",), recorded, SIGMA, 1.0)
    assert first_samples(objective) == SAMPLES
    assert first_samples(objective.truncate(4)) == 4
    wide = LinearStart(swing.estimate.mean, swing.estimate.modes.repeat(10, 1))
    many = objective.subset(()).with_start(EpisodeStarts((wide,))).forward_model
    whole = LeastSquaresProblem(many, recorded, objective.noise, torch.empty(0))
    assert first_samples(whole) == SAMPLES < whole.modes / recorded.shape[1]


def test_the_first_window_is_fitted_from_a_distant_start(swing: Swing) -> None:
    z = (-5.0, 6.0)
    recorded = noisy(swing.clean(z, (), ()), SIGMA, seed=1)
    objective = swing.objective(("k",), recorded, SIGMA, 1.0)
    window = objective.subset([]).truncate(SAMPLES)
    found = fit_first_window(objective, recorded.std(dim=0))
    exact = minimise(window, torch.tensor(z, dtype=torch.float64), 10, 1e-12)
    assert len(found.readings) == SAMPLES and len(found.phi) == 2
    torch.testing.assert_close(found.phi, exact.phi, rtol=1e-3, atol=1e-3)


def test_at_the_deadline_the_fit_ends_with_the_start_it_has(swing: Swing) -> None:
    recorded = noisy(swing.clean((-5.0, 6.0), (), ()), SIGMA, seed=1)
    objective = swing.objective(("k",), recorded, SIGMA, 1.0)
    found = fit_first_window(replace(objective, deadline=Deadline(0.0)), recorded.std(dim=0))
    assert found.jacobians == 0 and not found.phi.any()
    assert len(found.readings) == SAMPLES
