"""A gate's threshold has the interval of its profile: F rises to its ends as it should."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest
import torch

from dashred.discovery.gauss_newton import minimise
from dashred.discovery.hypothesis import Guess, Hypothesis, first_unknowns, pose
from dashred.discovery.law import Z95, law_of
from dashred.discovery.local_laws import Cause
from dashred.discovery.local_shooting import LocalShooting, found_by, localised
from dashred.discovery.threshold_profile import with_profile
from dashred.physics.window import Shape, gate, onset
from tests.waves import Waves, fitted

SIGMA, TRUE = 0.01, 0.2


@pytest.fixture(scope="module")
def waves(tmp_path_factory: pytest.TempPathFactory) -> Waves:
    return Waves.declared(tmp_path_factory.mktemp("waves"))


def gated(waves: Waves, shape: Shape, values: tuple[float, float]) -> Cause:
    """Return the fit of a term in a window, to a recording of that."""
    hidden = localised(waves.candidates(["u: v**2"]), shape.at(values))
    recorded = waves.recorded(SIGMA, 4, [(hidden[0], -0.4)])
    objective = waves.objective(recorded, SIGMA, ["u: v**2"])
    hypothesis = Hypothesis((), (0,), Guess(shape, values, (0.8, 1.0)))
    mine = pose(objective, hypothesis)
    z = fitted(waves.objective(recorded, SIGMA))
    found = minimise(mine, first_unknowns(z, [-0.4], hypothesis.guess), 12, 1e-6)
    law = law_of(mine, found, found_by(mine, found.phi), found.cost, 2)
    return Cause(law, mine, found.phi)


def held(cause: Cause, threshold: float) -> float:
    """Return F at its lowest in all else, the threshold held by the tightest of priors."""
    shooting = cause.objective.shooting
    assert isinstance(shooting, LocalShooting)
    place = len(shooting.guess)
    guess = shooting.guess.clone()
    moved = threshold - float(guess[0])
    guess[0] = threshold
    prior = cause.objective.prior_std.clone()
    spread = float(prior[-place])
    prior[-place] = 1e-9
    mine = replace(cause.objective, shooting=replace(shooting, guess=guess), prior_std=prior)
    phi = cause.phi.clone()
    phi[-place] = 0.0
    return minimise(mine, phi, 12, 1e-7).cost + (moved / spread) ** 2


def test_f_rises_by_four_to_the_ends(waves: Waves) -> None:
    cause = gated(waves, gate("u", 1), (TRUE, math.log(0.1)))
    law = with_profile(cause)
    assert law.threshold is not None and law.window is not None
    low, high = law.threshold
    assert low < law.window.values[0] < high and low < TRUE < high
    assert law.edges[0] == pytest.approx(
        max(high - law.window.values[0], law.window.values[0] - low, Z95 * cause.law.edges[0]) / Z95
    )
    [lowest], _ = cause.objective.values(cause.phi[None])
    for end in (low, high):
        assert held(cause, end) - float(lowest) == pytest.approx(Z95**2, abs=2.5)


def test_other_windows_and_laws_stay_as_they_are(waves: Waves) -> None:
    cause = gated(waves, onset(), (4.0, math.log(0.2)))
    assert with_profile(cause) is cause.law
    recorded = waves.recorded(SIGMA, 4)
    null = waves.objective(recorded, SIGMA)
    found = minimise(null, torch.zeros(null.modes, dtype=torch.float64), 4, 1e-3)
    plain = Cause(law_of(null, found, (), found.cost), null, found.phi)
    assert with_profile(plain) is plain.law
