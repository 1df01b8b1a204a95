"""A hypothesis near its minimum is refined; one that has lost the recording is left unchanged."""

from __future__ import annotations

from dataclasses import replace
from typing import Any, cast

import pytest
import torch
from torch import Tensor

from dashred.inference.fit.fitted_law import build_law
from dashred.inference.fit.levenberg_marquardt import FitResult, minimise, minimise_in_rounds
from dashred.inference.hypotheses import hypothesis_fit
from dashred.inference.hypotheses.hypothesis_fit import LOST_CHI2, POOR_CHI2, HypothesisFit, refine
from tests.waves import Waves

SIGMA, XI = 0.02, -0.25


def fit_term(waves: Waves, term: str = "u: u") -> HypothesisFit:
    """Return the fit of a term, right or wrong, to a recording with the hidden term ``u: u``."""
    recorded = waves.recorded(SIGMA, 1, [(waves.everything["u: u"], XI)], waves.start)
    objective = waves.objective(recorded, SIGMA, [term])
    found = minimise(objective, torch.zeros(objective.modes + 1, dtype=torch.float64), 20, 1e-6)
    return HypothesisFit(build_law(objective, found, found.cost), objective, found.phi)


def moved(fit: HypothesisFit, by: float) -> HypothesisFit:
    """Return a hypothesis whose coefficient is off by ``by``, as if its fit had ended too early."""
    phi = fit.phi.clone()
    phi[-1] += by
    [cost], (readings, _) = fit.objective.values(phi[None])
    chi2 = float(fit.objective.residuals(readings).square().sum()) / fit.objective.noise.count
    return HypothesisFit(replace(fit.law, score=float(cost), chi2=chi2), fit.objective, phi)


def test_a_fit_near_its_minimum_is_refined(waves: Waves) -> None:
    right = fit_term(waves)
    near = moved(right, 0.02)
    assert near.law.score > right.law.score + 10 and near.law.chi2 < LOST_CHI2
    found = refine(near)
    assert found.law.score == pytest.approx(right.law.score, abs=0.1)
    assert float(found.phi[-1]) == pytest.approx(float(right.phi[-1]), abs=1e-3)


def test_a_fit_that_has_lost_the_recording_is_unchanged(waves: Waves) -> None:
    lost = moved(fit_term(waves), 1.0)
    assert lost.law.chi2 > LOST_CHI2
    assert refine(lost) is lost


def watch_later_rounds(monkeypatch: pytest.MonkeyPatch) -> list[Tensor]:
    """Let no first round converge; return the unknowns at which later rounds begin."""
    beginnings: list[Tensor] = []

    def unfinished(*given: Any, **named: Any) -> FitResult:
        return replace(minimise(*given, **named), converged=False)

    def watched(*given: Any) -> FitResult:
        beginnings.append(given[1])
        return minimise_in_rounds(*given)

    monkeypatch.setattr(hypothesis_fit, "minimise", unfinished)
    monkeypatch.setattr(hypothesis_fit, "minimise_in_rounds", watched)
    return beginnings


def test_only_the_best_starting_point_is_continued(
    waves: Waves, monkeypatch: pytest.MonkeyPatch
) -> None:
    right = fit_term(waves)
    beginnings = watch_later_rounds(monkeypatch)
    found = refine(moved(right, 0.02))
    [lowest] = beginnings
    assert float(lowest[-1]) == pytest.approx(float(right.phi[-1]), abs=1e-3)
    assert found.law.score == pytest.approx(right.law.score, abs=0.1)


def test_a_poor_fit_is_not_continued_after_the_first_round(
    waves: Waves, monkeypatch: pytest.MonkeyPatch
) -> None:
    wrong = fit_term(waves, "u: u**3")
    assert POOR_CHI2 < wrong.law.chi2 < LOST_CHI2
    beginnings = watch_later_rounds(monkeypatch)
    found = refine(wrong)
    assert not beginnings
    assert POOR_CHI2 < found.law.chi2 <= wrong.law.chi2


@pytest.mark.parametrize(("begin", "leads"), [(0.8, True), (1.9, True), (-0.8, False)])
def test_a_start_leads_to_a_minimum_if_there_is_no_barrier(begin: float, leads: bool) -> None:
    """F = (φ² - 1)² + 1 has minima at -1 and 1, and a barrier at 0."""

    class DoubleWell:
        def values(self, phi: Tensor) -> tuple[Tensor, None]:
            return (phi[:, 0] ** 2 - 1).square() + 1, None

    readings = torch.zeros(0)
    lowest = FitResult(torch.ones(1, dtype=torch.float64), 1.0, 0.0, readings, True, 1)
    start = torch.tensor([begin], dtype=torch.float64)
    assert hypothesis_fit._leads_to(cast(Any, DoubleWell()), start, lowest) is leads


def test_starts_that_lead_to_the_same_minimum_are_not_fitted(
    waves: Waves, monkeypatch: pytest.MonkeyPatch
) -> None:
    fits: list[FitResult] = []

    def counted(*given: Any, **named: Any) -> FitResult:
        fits.append(minimise(*given, **named))
        return fits[-1]

    right = fit_term(waves)
    monkeypatch.setattr(hypothesis_fit, "minimise", counted)
    refine(right)
    # The fit itself, and one under each of the larger noises.
    assert len(fits) == 1 + len(hypothesis_fit.NOISE_FACTORS)
