"""Terms that do not help are dropped: the same initial state fits as well without them."""

from __future__ import annotations

from dataclasses import replace

import pytest
import torch

from dashred.inference.fit.fitted_law import build_law
from dashred.inference.fit.least_squares import LeastSquaresProblem
from dashred.inference.fit.levenberg_marquardt import minimise
from dashred.inference.hypotheses.comparison.backward_elimination import eliminate_terms
from dashred.inference.hypotheses.hypothesis_fit import HypothesisFit
from dashred.inference.hypotheses.sensors.excluded_sensors import add_faults
from dashred.inference.initial_state.start_models import ScaledStart
from tests.waves import Waves, fitted

SIGMA = 0.02
FAR = 3.0


def fit_hypothesis(
    objective: LeastSquaresProblem, phi: torch.Tensor, penalty: float = 0.0
) -> HypothesisFit:
    """Return a hypothesis fitted from the given unknowns."""
    found = minimise(objective, phi, 10, 1e-6)
    law = build_law(objective, found, found.cost + penalty)
    return HypothesisFit(law, objective, found.phi)


def displaced(right: HypothesisFit) -> HypothesisFit:
    """Return a hypothesis whose fit ended far from the right minimum."""
    phi = right.phi + FAR
    [cost], _ = right.objective.values(phi[None])
    return HypothesisFit(replace(right.law, score=float(cost)), right.objective, phi)


def fits(waves: Waves, xi: float, factor: float = 1.0) -> tuple[HypothesisFit, HypothesisFit]:
    """Return the fits of a law and of the uncorrected simulator to a recording with that law."""
    start = ScaledStart(waves.start, factor)
    law = [(waves.everything["u: u"], xi)]
    recorded = waves.recorded(SIGMA, 1, law, start)
    null = waves.objective(recorded, SIGMA)
    nothing = fit_hypothesis(null, fitted(null))
    objective = waves.objective(recorded, SIGMA, ["u: u"])
    found = fit_hypothesis(objective, objective.embed(nothing.phi, []), penalty=10.0)
    return found, nothing


def test_a_term_that_does_nothing_is_dropped(waves: Waves) -> None:
    law, nothing = fits(waves, 0.0)
    lost = displaced(nothing)
    assert law.law.score < lost.law.score - 100
    [found] = eliminate_terms([lost, law])
    assert not found.law.candidates
    assert found.law.score == pytest.approx(nothing.law.score, abs=0.1)
    assert found.law.score < law.law.score


def test_a_term_that_does_something_is_kept(waves: Waves) -> None:
    law, nothing = fits(waves, -0.25)
    assert all(found.law.score > law.law.score + 100 for found in eliminate_terms([nothing, law]))


def test_no_refit_if_the_best_has_no_terms(waves: Waves) -> None:
    _, nothing = fits(waves, 0.0)
    assert eliminate_terms([nothing, displaced(nothing)]) == []


def test_a_wider_prior_is_refitted_from_the_best_start(waves: Waves) -> None:
    law, _ = fits(waves, 0.0)
    objective = law.objective.subset(())
    wider = objective.with_start(ScaledStart(waves.start, 4.0))
    right = fit_hypothesis(wider, law.phi[: law.objective.modes] / 4.0)
    [found] = eliminate_terms([displaced(right), law])
    assert found.law.score == pytest.approx(right.law.score, abs=0.1)


def test_a_sensor_fault_is_kept(waves: Waves) -> None:
    law, nothing = fits(waves, 0.0)
    lost = add_faults(displaced(nothing), (0,))
    [found] = eliminate_terms([lost, law])
    excluded = found.excluded
    assert excluded is not None and excluded.sensors == (0,)
    assert excluded.without_faults.law.score == pytest.approx(nothing.law.score, abs=0.1)
