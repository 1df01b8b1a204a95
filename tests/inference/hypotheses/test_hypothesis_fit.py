"""An explanation near its minimum is settled there; one that has lost the recording is left."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import pytest
import torch
from torch import Tensor

from dashred.inference.fit.law import law_of
from dashred.inference.fit.levenberg_marquardt import Fitted, minimise, minimise_on
from dashred.inference.hypotheses import hypothesis_fit as settling
from dashred.inference.hypotheses.hypothesis_fit import LOST_CHI2, POOR_CHI2, HypothesisFit, refine
from tests.waves import Waves

SIGMA, XI = 0.02, -0.25


def explained(waves: Waves, term: str = "u: u") -> HypothesisFit:
    """Return a term, the right one or another, fitted to what is recorded under ``u: u``."""
    recorded = waves.recorded(SIGMA, 1, [(waves.everything["u: u"], XI)], waves.start)
    objective = waves.objective(recorded, SIGMA, [term])
    found = minimise(objective, torch.zeros(objective.modes + 1, dtype=torch.float64), 20, 1e-6)
    return HypothesisFit(law_of(objective, found, found.cost), objective, found.phi)


def moved(fit: HypothesisFit, by: float) -> HypothesisFit:
    """Return an explanation whose fit has ended too early, its coefficient off by so much."""
    phi = fit.phi.clone()
    phi[-1] += by
    [cost], (readings, _) = fit.objective.values(phi[None])
    chi2 = float(fit.objective.residuals(readings).square().sum()) / fit.objective.noise.count
    return HypothesisFit(replace(fit.law, score=float(cost), chi2=chi2), fit.objective, phi)


def test_what_is_near_its_minimum_is_settled_there(waves: Waves) -> None:
    right = explained(waves)
    near = moved(right, 0.02)
    assert near.law.score > right.law.score + 10 and near.law.chi2 < LOST_CHI2
    found = refine(near)
    assert found.law.score == pytest.approx(right.law.score, abs=0.1)
    assert float(found.phi[-1]) == pytest.approx(float(right.phi[-1]), abs=1e-3)


def test_what_has_lost_the_recording_is_left_as_it_is(waves: Waves) -> None:
    lost = moved(explained(waves), 1.0)
    assert lost.law.chi2 > LOST_CHI2
    assert refine(lost) is lost


def begun_anew(monkeypatch: pytest.MonkeyPatch) -> list[Tensor]:
    """Make no round enough, and return where the fits that go on after it begin, as they do."""
    beginnings: list[Tensor] = []

    def unfinished(*given: Any) -> Fitted:
        return replace(minimise(*given), converged=False)

    def watched(*given: Any) -> Fitted:
        beginnings.append(given[1])
        return minimise_on(*given)

    monkeypatch.setattr(settling, "minimise", unfinished)
    monkeypatch.setattr(settling, "minimise_on", watched)
    return beginnings


def test_of_all_beginnings_one_alone_goes_on(waves: Waves, monkeypatch: pytest.MonkeyPatch) -> None:
    right = explained(waves)
    beginnings = begun_anew(monkeypatch)
    found = refine(moved(right, 0.02))
    [lowest] = beginnings
    assert float(lowest[-1]) == pytest.approx(float(right.phi[-1]), abs=1e-3)
    assert found.law.score == pytest.approx(right.law.score, abs=0.1)


def test_what_is_far_after_a_round_ends_there(
    waves: Waves, monkeypatch: pytest.MonkeyPatch
) -> None:
    wrong = explained(waves, "u: u**3")
    assert POOR_CHI2 < wrong.law.chi2 < LOST_CHI2
    beginnings = begun_anew(monkeypatch)
    found = refine(wrong)
    assert not beginnings
    assert POOR_CHI2 < found.law.chi2 <= wrong.law.chi2
