"""A start that lies outside of its prior is told with how far; another explains nothing."""

from __future__ import annotations

import pytest

from dashred.inference.hypotheses.hypothesis_fit import HypothesisFit
from dashred.inference.hypotheses.sensors.sensor_and_start_faults import fit_start_hypotheses
from dashred.inference.initial_state.start_models import ScaledStart
from tests import laws
from tests.waves import Waves, fitted

SIGMA = 0.02


def nothing(waves: Waves, factor: float, seed: int) -> HypothesisFit:
    """Return the simulator's fit to a recording of itself, from a start so far off."""
    recorded = waves.recorded(SIGMA, seed, start=ScaledStart(waves.start, factor))
    objective = waves.objective(recorded, SIGMA)
    phi = fitted(objective)
    [cost], _ = objective.values(phi[None])
    return HypothesisFit(laws.law(score=float(cost)), objective, phi)


@pytest.mark.parametrize("seed", [0, 1])
def test_how_far_off_it_is_is_told(waves: Waves, seed: int) -> None:
    null = nothing(waves, 4.0, seed)
    [found] = fit_start_hypotheses(null)
    assert 2.5 <= found.law.widened <= 6.4
    assert found.law.score < null.law.score - 6
    assert not found.law.candidates


@pytest.mark.parametrize("seed", range(3))
def test_a_start_as_the_prior_has_it_explains_nothing(waves: Waves, seed: int) -> None:
    null = nothing(waves, 1.0, seed)
    assert all(found.law.score > null.law.score for found in fit_start_hypotheses(null))


@pytest.mark.parametrize("far", [3.0, 300.0])
def test_it_is_found_from_a_fit_that_was_led_astray(waves: Waves, far: float) -> None:
    null = nothing(waves, 4.0, seed=0)
    [right] = fit_start_hypotheses(null)
    phi = null.phi + far
    [cost], _ = null.objective.values(phi[None])
    led = HypothesisFit(laws.law(score=float(cost)), null.objective, phi)
    [found] = fit_start_hypotheses(led)
    assert found.law.widened == right.law.widened
    assert found.law.chi2 == pytest.approx(right.law.chi2, rel=1e-3)
    assert found.law.score == pytest.approx(right.law.score, abs=10)
