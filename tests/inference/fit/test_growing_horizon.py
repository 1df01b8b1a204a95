"""The horizon grows as far as the candidates explain the recording."""

from __future__ import annotations

import math
from dataclasses import replace
from itertools import pairwise
from statistics import median

import pytest
from torch import Tensor

from dashred.core.progress import Report
from dashred.inference.fit.first_window import first_samples, fit_first_window
from dashred.inference.fit.growing_horizon import (
    GROWTH,
    HorizonFit,
    fit_first_horizon,
    grow_horizon,
)
from dashred.inference.fit.horizon_state import DIVERGED
from dashred.inference.fit.least_squares import LeastSquaresProblem, NormalEquations
from dashred.inference.fit.levenberg_marquardt import FitResult, minimise
from tests.swing import FORCES, TIMES, Swing, noisy

SIGMA, TIGHT = 0.05, 0.05
NAMES = ("k", "c", *FORCES)
Z = (0.8, -0.6)
LATE = 40  # the sample at t = 6


def silent(_: float, __: str) -> None:
    """Report nothing."""


def fitted(objective: LeastSquaresProblem) -> Tensor:
    """Return the fit of the first window among all unknowns."""
    window = fit_first_window(objective, objective.recorded.std(dim=0))
    return objective.embed(window.phi, [])


def grow(
    objective: LeastSquaresProblem, count: int = len(NAMES), report: Report = silent
) -> HorizonFit:
    """Extend the horizon from the fit of the first window."""
    first = fit_first_horizon(objective, fitted(objective), first_samples(objective), count)
    return grow_horizon(first, count, report)


def grown(swing: Swing, recorded: Tensor) -> HorizonFit:
    return grow(swing.objective(NAMES, recorded, SIGMA, TIGHT))


@pytest.fixture(scope="module")
def missing(swing: Swing) -> Tensor:
    """A recording of a swing with a force that is among the candidates."""
    return noisy(swing.clean(Z, ("x**3",), (-0.3,)), SIGMA, seed=0)


def test_the_horizon_reaches_the_end_if_candidates_explain_the_recording(
    swing: Swing, missing: Tensor
) -> None:
    found = grown(swing, missing)
    assert found.is_complete and found.samples == len(TIMES) == len(found.readings)
    samples = [count for count, _ in found.levels]
    assert samples[0] == 6 and samples[-1] == len(TIMES)
    assert all(a < b <= max(a + 1, round(GROWTH * a)) for a, b in pairwise(samples))
    assert all(level < 1.5 for _, level in found.levels)
    assert found.levels[-1][1] == pytest.approx(1.0, abs=0.25)
    # A tight prior spreads the force over similar candidates; the trajectory is right.
    clean = swing.clean(Z, ("x**3",), (-0.3,))
    assert float((found.readings - clean).square().mean().sqrt()) < SIGMA / 2


def test_the_horizon_stops_without_the_true_candidate(swing: Swing, missing: Tensor) -> None:
    objective = swing.objective(("1",), missing, SIGMA, TIGHT)
    assert not grow(objective).is_complete


@pytest.mark.parametrize(("force", "value"), [("step(t - 6)", 3.0), ("step(t - 6)*sin(5*t)", 3.0)])
def test_the_horizon_stops_where_the_law_changes(swing: Swing, force: str, value: float) -> None:
    """The recording follows one law in its first half, then a law outside the library."""
    recorded = noisy(swing.foreign(Z, force, value), SIGMA, seed=0)
    found = grown(swing, recorded)
    assert not found.is_complete
    assert LATE - 5 <= found.samples <= LATE + 5
    assert len(found.readings) == found.samples == found.levels[-1][0]
    assert found.levels[-1][1] <= DIVERGED * max(
        1.0, median(level for _, level in found.levels[:-1])
    )
    # Up to there the fit is that of the first law.
    clean = swing.clean(Z, (), ())[: LATE - 5]
    gap = found.readings[: LATE - 5] - clean
    assert float(gap.square().mean().sqrt()) < SIGMA


def test_a_fit_that_blows_up_is_rejected(
    swing: Swing, missing: Tensor, monkeypatch: pytest.MonkeyPatch
) -> None:
    def blown(
        objective: LeastSquaresProblem,
        phi: Tensor,
        steps: int,
        tolerance: float,
        known: NormalEquations | None = None,
    ) -> FitResult:
        found = minimise(objective, phi, steps, tolerance, known)
        lost = len(objective.recorded) > LATE
        return replace(found, cost=math.inf, chi2=math.nan) if lost else found

    for name in ("horizon_state", "selection.widened_fit"):
        monkeypatch.setattr(f"dashred.inference.fit.{name}.minimise", blown)
    found = grown(swing, missing)
    assert not found.is_complete and LATE - 5 <= found.samples <= LATE
    assert all(math.isfinite(level) for _, level in found.levels)


def test_a_fit_with_few_candidates_reaches_the_end(swing: Swing, missing: Tensor) -> None:
    objective = swing.objective(NAMES, missing, SIGMA, TIGHT)
    found = grow(objective, 2)
    assert found.is_complete and 2 <= len(found.members) < len(NAMES)
    assert found.levels[-1][1] == pytest.approx(1.0, abs=0.25)
    others = sorted(set(range(len(NAMES))) - set(found.members))
    assert not found.phi[[2 + j for j in others]].any()


def test_an_expensive_horizon_is_given_up(
    swing: Swing, missing: Tensor, monkeypatch: pytest.MonkeyPatch
) -> None:
    objective = swing.objective(NAMES, missing, SIGMA, TIGHT)
    monkeypatch.setattr("dashred.inference.fit.growing_horizon.EFFORT", 1)
    found = grow(objective)
    assert not found.is_complete and 6 < found.samples < len(TIMES)
    assert len(found.readings) == found.samples


def test_progress_is_reported(swing: Swing, missing: Tensor) -> None:
    reports: list[tuple[float, str]] = []
    objective = swing.objective(NAMES, missing, SIGMA, TIGHT)
    found = grow(objective, report=lambda done, text: reports.append((done, text)))
    assert [done for done, _ in reports] == [count / 81 for count, _ in found.levels[1:]]
    assert reports[-1][0] == 1.0 and reports[-1][1].startswith("horizon 81 of 81, χ²/n ")


def test_a_record_of_one_window_is_complete_at_once(swing: Swing, missing: Tensor) -> None:
    objective = swing.objective(NAMES, missing, SIGMA, TIGHT).truncate(6)
    found = grow(objective)
    assert found.is_complete and [count for count, _ in found.levels] == [6]


STRONG = ("x**3", -3.0)


@pytest.fixture(scope="module")
def strong(swing: Swing) -> Tensor:
    """A recording with a force that is far stronger than the narrow prior allows."""
    return noisy(swing.clean(Z, STRONG[:1], STRONG[1:]), SIGMA, seed=0)


def test_the_evidence_widens_the_prior_of_a_strong_force(swing: Swing, strong: Tensor) -> None:
    objective = swing.objective(NAMES, strong, SIGMA, TIGHT)
    found = grow(objective)
    assert found.is_complete and found.levels[-1][1] == pytest.approx(1.0, abs=0.25)
    assert [NAMES[j] for j in found.widened] == [STRONG[0]]
    assert found.widest > 1
    assert float(found.phi[2 + found.widened[0]]) == pytest.approx(STRONG[1], rel=0.1)


def test_a_narrow_prior_alone_shrinks_a_strong_force(
    swing: Swing, strong: Tensor, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("dashred.inference.fit.selection.widened_fit.ROUNDS", 0)
    objective = swing.objective(NAMES, strong, SIGMA, TIGHT)
    found = grow(objective)
    assert not found.widened and found.levels[-1][1] > 2
    assert abs(float(found.phi[2 + NAMES.index(STRONG[0])])) < abs(STRONG[1]) / 2


def test_a_weak_force_widens_no_prior(swing: Swing, missing: Tensor) -> None:
    assert grown(swing, missing).widened == ()


def test_a_stretch_that_the_widened_law_predicts_is_not_fitted(
    swing: Swing, strong: Tensor, monkeypatch: pytest.MonkeyPatch
) -> None:
    fits: list[tuple[int, int]] = []

    def counted(
        objective: LeastSquaresProblem, phi: Tensor, steps: int, tolerance: float
    ) -> FitResult:
        fits.append((len(objective.recorded), steps))
        return minimise(objective, phi, steps, tolerance)

    monkeypatch.setattr("dashred.inference.fit.horizon_state.minimise", counted)
    objective = swing.objective(NAMES, strong, SIGMA, TIGHT)
    found = grow(objective)
    predicted = {samples for samples, steps in fits if not steps}
    refitted = {samples for samples, steps in fits if steps}
    assert found.is_complete and predicted - refitted
    # The whole record is always fitted.
    assert len(TIMES) in refitted - predicted
