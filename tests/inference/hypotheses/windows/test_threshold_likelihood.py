"""The profile interval of a gate's threshold: F rises to its ends as it should."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest
import torch

from dashred.core.formatting import Z95
from dashred.inference.fit.fitted_law import build_law
from dashred.inference.fit.levenberg_marquardt import minimise
from dashred.inference.hypotheses.hypothesis_fit import HypothesisFit
from dashred.inference.hypotheses.windows.threshold_likelihood import profile_threshold
from dashred.inference.hypotheses.windows.window_restarts import move_window
from dashred.physics.window import gate, onset
from tests.waves import LOCAL_SIGMA, Waves, in_window

TRUE = 0.2


@pytest.fixture(scope="module")
def waves(tmp_path_factory: pytest.TempPathFactory) -> Waves:
    return Waves.declared(tmp_path_factory.mktemp("waves"))


def minimum_at(fit: HypothesisFit, threshold: float) -> float:
    """Return the minimum of F at a fixed threshold, which a narrow prior holds."""
    windowed = fit.objective.forward_model.law.windowed
    assert windowed is not None
    place = len(windowed.guess)
    guess = windowed.guess.clone()
    moved = threshold - float(guess[0])
    guess[0] = threshold
    prior = fit.objective.prior_std.clone()
    spread = float(prior[-place])
    prior[-place] = 1e-9
    problem = replace(move_window(fit.objective, guess), prior_std=prior)
    phi = fit.phi.clone()
    phi[-place] = 0.0
    return minimise(problem, phi, 12, 1e-7).cost + (moved / spread) ** 2


def test_f_rises_by_four_to_the_ends(waves: Waves) -> None:
    fit = in_window(waves, gate("u", 1), (TRUE, math.log(0.1)))
    law = profile_threshold(fit)
    assert law.threshold is not None and law.window is not None
    low, high = law.threshold
    assert low < law.window.values[0] < high and low < TRUE < high
    assert law.edges[0] == pytest.approx(
        max(high - law.window.values[0], law.window.values[0] - low, Z95 * fit.law.edges[0]) / Z95
    )
    [lowest], _ = fit.objective.values(fit.phi[None])
    for end in (low, high):
        assert minimum_at(fit, end) - float(lowest) == pytest.approx(Z95**2, abs=2.5)


def test_other_windows_and_laws_are_unchanged(waves: Waves) -> None:
    fit = in_window(waves, onset(), (4.0, math.log(0.2)))
    assert profile_threshold(fit) is fit.law
    recorded = waves.recorded(LOCAL_SIGMA, 4)
    null = waves.objective(recorded, LOCAL_SIGMA)
    found = minimise(null, torch.zeros(null.modes, dtype=torch.float64), 4, 1e-3)
    plain = HypothesisFit(build_law(null, found, found.cost), null, found.phi)
    assert profile_threshold(plain) is plain.law
