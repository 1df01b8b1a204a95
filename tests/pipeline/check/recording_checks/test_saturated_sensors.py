"""Sensors that seem to saturate are pointed out by the check."""

from __future__ import annotations

import numpy as np
import pytest

from dashred.data.recording import Recording
from dashred.data.sensors import Sensor
from dashred.pipeline.check.recording_checks.saturation import saturated

TIMES = np.linspace(0.0, 39.9, 400)
NOISY = np.sin(TIMES) + 0.01 * np.random.default_rng(0).standard_normal(len(TIMES))


@pytest.mark.parametrize(
    ("values", "reads"),
    [
        (NOISY.clip(-0.8, 0.8), "clip(FIELD, -0.8, 0.8)"),
        (NOISY.clip(None, 0.8), "min(FIELD, 0.8)"),
        (NOISY.clip(-0.8), "max(FIELD, -0.8)"),
    ],
)
def test_readings_at_a_stop_are_pointed_out(values: np.ndarray, reads: str) -> None:
    [remark] = saturated(Recording((Sensor("u", "u"),), TIMES, values[:, None]))
    assert remark.hint is not None and remark.hint.endswith(f"let: {{u: {reads}}}")
    sensor = Sensor("u", "u", has_stops=True)
    assert not [*saturated(Recording((sensor,), TIMES, values[:, None]))]


@pytest.mark.parametrize(
    "values",
    [NOISY, NOISY.round(1), np.round(5 * NOISY), NOISY.clip(0), np.full(len(TIMES), 2.0)],
)
def test_other_readings_are_not(values: np.ndarray) -> None:
    assert not [*saturated(Recording((Sensor("u", "u"),), TIMES, values[:, None]))]
