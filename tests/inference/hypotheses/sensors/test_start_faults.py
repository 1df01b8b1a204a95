"""An initial state outside its prior is found with its factor; others are not found."""

from __future__ import annotations

import pytest
import torch
from torch import Tensor

from dashred.core.budget import Budget
from dashred.inference.hypotheses.comparison.compare_hypotheses import compare_hypotheses
from dashred.inference.hypotheses.comparison.comparison import Additions
from dashred.inference.hypotheses.hypothesis_fit import HypothesisFit
from dashred.inference.hypotheses.result import MIN_FORCING_GAIN
from dashred.inference.hypotheses.sensors.start_hypotheses import fit_start_hypotheses
from dashred.inference.initial_state.start_models import ScaledStart
from dashred.physics.solvers.simulate import simulate
from tests import laws
from tests.waves import TIMES, Waves, fitted

SIGMA = 0.02


def fit_simulator(waves: Waves, factor: float, seed: int) -> HypothesisFit:
    """Return the simulator's fit to its own recording, with an initial state outside the prior."""
    return fit_to(waves, waves.recorded(SIGMA, seed, start=ScaledStart(waves.start, factor)))


def fit_to(waves: Waves, recorded: Tensor) -> HypothesisFit:
    """Return the simulator's fit to a recording."""
    objective = waves.objective(recorded, SIGMA)
    phi = fitted(objective)
    [cost], _ = objective.values(phi[None])
    return HypothesisFit(laws.law(score=float(cost)), objective, phi)


@pytest.mark.parametrize("seed", [0, 1])
def test_the_factor_is_found(waves: Waves, seed: int) -> None:
    null = fit_simulator(waves, 4.0, seed)
    [found] = fit_start_hypotheses(null)
    assert 2.5 <= found.law.start_prior_factor <= 6.4
    assert found.law.score < null.law.score - 6
    assert not found.law.candidates
    # Of the starts of the stated prior, 1.4 % are as far off as the one that the second seed draws.
    assert found.law.has_other_start == (seed == 0)


@pytest.mark.parametrize("seed", range(3))
def test_an_initial_state_within_the_prior_explains_fit_simulator(waves: Waves, seed: int) -> None:
    null = fit_simulator(waves, 1.0, seed)
    assert all(found.law.score > null.law.score for found in fit_start_hypotheses(null))


@pytest.mark.parametrize("far", [3.0, 300.0])
def test_it_is_found_from_a_fit_in_a_wrong_minimum(waves: Waves, far: float) -> None:
    null = fit_simulator(waves, 4.0, seed=0)
    [right] = fit_start_hypotheses(null)
    phi = null.phi + far
    [cost], _ = null.objective.values(phi[None])
    misled = HypothesisFit(laws.law(score=float(cost)), null.objective, phi)
    [found] = fit_start_hypotheses(misled)
    assert found.law.start_prior_factor == right.law.start_prior_factor
    assert found.law.chi2 == pytest.approx(right.law.chi2, rel=1e-3)
    assert found.law.score == pytest.approx(right.law.score, abs=10)


@pytest.fixture(scope="module")
def of_other_shape(waves: Waves) -> Tensor:
    """Readings from a start whose short waves are improbable, but which is within its spread."""
    z = torch.zeros(waves.start.size, dtype=torch.float64)
    z[[3, 4]] = 20.0
    [begin] = waves.start.start(z[None])
    recorded = waves.operator(simulate(waves.system, begin, TIMES))[0]
    return recorded + SIGMA * torch.randn(
        recorded.shape, generator=torch.Generator().manual_seed(1)
    )


def test_a_start_of_another_shape_is_no_cause(waves: Waves, of_other_shape: Tensor) -> None:
    null = fit_to(waves, of_other_shape)
    [found] = fit_start_hypotheses(null)
    assert found.law.score < null.law.score - 6
    assert not found.law.has_other_start and not found.law.parts


def test_with_a_start_of_another_shape_nothing_is_missing(
    waves: Waves, of_other_shape: Tensor
) -> None:
    null = fit_to(waves, of_other_shape)
    everything = waves.objective(of_other_shape, SIGMA, list(waves.everything))
    additions = Additions(len(waves.everything), waves.size, lambda: waves.simulator, list)
    found = compare_hypotheses(everything, null, null, [], additions, Budget(), lambda *_: None)
    best = found.laws[0]
    assert not best.parts
    assert min(law.start_prior_factor for law in found.laws) > 1
    assert not any(law.has_other_start for law in found.laws)
    assert found.forcing_gain < MIN_FORCING_GAIN
