"""Sensor faults are compared first: a budget that runs out costs the rarer causes."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import pytest

from dashred.core import budget as clock_module
from dashred.core.budget import Budget, Deadline, OutOfTimeError
from dashred.inference.fit.fitted_law import build_law
from dashred.inference.fit.levenberg_marquardt import minimise
from dashred.inference.hypotheses.comparison import compare_hypotheses as module
from dashred.inference.hypotheses.comparison.comparison import Additions, Comparison
from dashred.inference.hypotheses.hypothesis_fit import HypothesisFit
from tests.waves import Waves, fitted

SIGMA, BIAS = 0.02, 0.4


@dataclass
class Clock:
    """A clock whose time is set by hand."""

    now: float = 0.0

    def monotonic(self) -> float:
        """Return the time that was set."""
        return self.now


def compare_until(waves: Waves, clock: Clock, budget: Budget) -> Comparison:
    """Compare the hypotheses for a biased sensor; the deadline is at 1 s."""
    recorded = waves.recorded(SIGMA, 1)
    recorded[:, 2] += BIAS
    deadline = Deadline(1.0)
    everything = waves.objective(recorded, SIGMA, list(waves.everything))
    null = waves.objective(recorded, SIGMA)
    found = minimise(null, fitted(null), 6, 1e-4)
    everything = replace(everything, deadline=deadline)
    null = replace(null, deadline=deadline)
    empty = HypothesisFit(build_law(null, found, found.cost), null, found.phi)
    additions = Additions(len(waves.everything), waves.size, lambda: waves.simulator, list)
    return module.compare_hypotheses(
        everything, empty, empty, [], additions, budget, lambda *_: None
    )


def end_at(monkeypatch: pytest.MonkeyPatch, clock: Clock, stage: str) -> None:
    """Let the time end when a stage of the comparison begins."""
    compute: Callable[..., Any] = getattr(module, stage)

    def late(*arguments: Any) -> Any:
        clock.now = 2.0
        return compute(*arguments)

    monkeypatch.setattr(module, stage, late)


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> Clock:
    clock = Clock()
    monkeypatch.setattr(clock_module, "time", clock)
    return clock


@pytest.mark.parametrize("stage", ["fit_residual_forcing", "fit_other_starts"])
def test_a_fault_is_found_before_the_time_ends(
    waves: Waves, monkeypatch: pytest.MonkeyPatch, clock: Clock, stage: str
) -> None:
    end_at(monkeypatch, clock, stage)
    budget = Budget()
    found = compare_until(waves, clock, budget)
    [fault] = found.laws[0].faults
    assert (fault.kind, fault.sensor) == ("bias", "s2")
    assert abs(fault.value - BIAS) < 0.1
    assert not any("fault" in what and "other than" not in what for what in budget.not_tried)
    if stage == "fit_residual_forcing":
        assert found.is_cut_short and budget.not_tried == ["causes other than sensor faults"]


def test_a_source_is_told_where_it_is_if_the_time_ends(
    waves: Waves, monkeypatch: pytest.MonkeyPatch, clock: Clock
) -> None:
    source: Any = object()

    def with_source(best: HypothesisFit, *_: Any) -> list[HypothesisFit]:
        return [replace(best, law=replace(best.law, source=source))]

    monkeypatch.setattr(module, "fit_fault_hypotheses", with_source)
    end_at(monkeypatch, clock, "fit_residual_forcing")
    found = compare_until(waves, clock, Budget())
    assert found.is_cut_short and found.source is source


def test_without_time_for_faults_nothing_is_compared(
    waves: Waves, monkeypatch: pytest.MonkeyPatch, clock: Clock
) -> None:
    end_at(monkeypatch, clock, "fit_fault_hypotheses")
    with pytest.raises(OutOfTimeError):
        compare_until(waves, clock, Budget())
