"""Rates of the machine: a coarse clock of the CPU does not distort them."""

from __future__ import annotations

import math
import time

import pytest

from dashred.evaluation.performance.measured import rates


@pytest.mark.parametrize("kernel", [3e-6, 37e-6, 5e-3, 0.3])
@pytest.mark.parametrize("tick", [1e-9, 4e-3])
def test_the_time_of_a_kernel(monkeypatch: pytest.MonkeyPatch, kernel: float, tick: float) -> None:
    now = 0.0

    def run() -> None:
        nonlocal now
        now += kernel

    monkeypatch.setattr(time, "process_time", lambda: math.floor(now / tick) * tick)
    assert rates._shortest(run) == pytest.approx(kernel, rel=tick / rates.BATCH + 1e-6)
