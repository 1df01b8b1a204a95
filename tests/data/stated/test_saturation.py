"""Readings at the stop of a sensor say nothing of its noise."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import torch

from dashred.data.noise_level import noise_std
from dashred.data.recording import Recording
from dashred.data.sensors import Sensor
from dashred.data.stated.saturation import at_stop, has_stops, values_at_stop
from dashred.inference.fit.noise_model import NoiseModel
from dashred.inference.segments.segments import cut
from tests import laws

TEXT = """
system:
  title: a swing
  fields: {x: place}
  parameters: {k: 0.5}
  inputs: {e: volt}
  let:
    shown: clip(2*x, -1, 1)
    high: max(x, 0)
    switched: x*step(e)
    whole: 3*x
  equations: {x: -k*x}
  start: {x: 1}
  integrator: {dt: 0.1}
recording: {path: a.csv}
"""
TIMES = np.linspace(0.0, 99.95, 2000)
SIGMA = 0.02


def clipped() -> np.ndarray:
    noise = SIGMA * np.random.default_rng(1).standard_normal(len(TIMES))
    return np.clip(1.6 * np.sin(TIMES) + noise, -1, 1)


def test_which_quantities_have_stops(tmp_path: Path) -> None:
    system = laws.declared(tmp_path, TEXT)
    found = {name: has_stops(system, name) for name in ("shown", "high", "whole", "x")}
    assert found == {"shown": True, "high": True, "whole": False, "x": False}


def test_readings_at_a_stop() -> None:
    assert values_at_stop(np.array([1, 3, 3, 2, np.nan, 0.5])).tolist() == [0, 1, 1, 0, 0, 0]
    assert not values_at_stop(np.array([np.nan, np.nan])).any()
    values = np.column_stack([clipped(), clipped()])
    sensors = Sensor("a", "shown", has_stops=True), Sensor("b", "x")
    mask = at_stop(Recording(sensors, TIMES, values))
    assert mask is not None and 0.5 < mask[:, 0].mean() < 0.62 and not mask[:, 1].any()
    assert at_stop(Recording((Sensor("b", "x"),), TIMES, values[:, :1])) is None


def test_the_noise_is_that_of_the_other_readings() -> None:
    recording = Recording((Sensor("a", "shown", has_stops=True),), TIMES, clipped()[:, None])
    assert noise_std(recording)[0] == pytest.approx(SIGMA, rel=0.15)


def test_residuals_at_a_stop_do_not_count() -> None:
    values = clipped()
    mask = torch.from_numpy(values_at_stop(values))[:, None]
    residuals = torch.from_numpy(np.clip(1.6 * np.sin(TIMES), -1, 1) - values)[:, None]
    std = torch.tensor([SIGMA], dtype=torch.float64)
    model = NoiseModel(std, 0 * std, torch.ones_like(mask), None, mask)
    assert model.count == int((~mask).sum()) < 0.5 * len(values)
    assert float(model.estimate(residuals, ["a"], 0.0).std) == pytest.approx(SIGMA, rel=0.1)
    segments = cut([TIMES], [values[:, None]], 4, (), [mask.numpy().astype(float)])
    assert segments.seen == model.count and segments.available.sum() == len(values)
