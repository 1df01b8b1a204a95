"""Latency of one step for a single window, without the warm-up steps."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest
import torch

from dashred.data.observation_operator import ObservationOperator
from dashred.models.latency import TIMED_STEPS, WARM_UP_STEPS, seconds_per_step
from tests.ring import SENSORS, ensemble, linear_system, untrained


def ticking(slow: float, fast: float) -> Iterator[float]:
    """Yield the times of a clock: warm-up steps are slow, the others fast."""
    now = 0.0
    for step in range(WARM_UP_STEPS + TIMED_STEPS):
        yield now
        now += slow if step < WARM_UP_STEPS else fast
        yield now


def test_the_median_of_the_steps_after_the_first(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    system = linear_system(tmp_path)
    operator = ObservationOperator(SENSORS, system)
    shred = untrained(ensemble(system, 4).states, operator)
    clock = ticking(1.0, 0.002)
    monkeypatch.setattr("dashred.models.latency.time.perf_counter", lambda: next(clock))
    window = torch.zeros((5, len(SENSORS)), dtype=torch.float64)
    assert seconds_per_step(shred, window) == pytest.approx(0.002)


def test_one_thread_is_timed_and_the_others_are_restored() -> None:
    before, during = torch.get_num_threads(), []
    torch.set_num_threads(2)

    def step(window: torch.Tensor) -> torch.Tensor:
        during.append(torch.get_num_threads())
        return window

    try:
        seconds_per_step(step, torch.zeros(3, 2))  # type: ignore[arg-type]
        assert set(during) == {1} and torch.get_num_threads() == 2
    finally:
        torch.set_num_threads(before)
