"""Natural scales of a field that is read through a function of it, or hidden by noise."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from dashred.data.sensors import Sensor
from dashred.inference.segments.natural_scales import natural_scales
from dashred.inference.segments.segments import cut
from dashred.inference.segments.state_sensors import StateSensors
from dashred.inference.segments.steps.segment_simulator import SegmentSimulator
from tests import laws

FADING = """
system:
  title: absorbance that fades, read as transmitted light
  fields: {a: absorbance}
  parameters: {g: 1000}
  let: {light: g*exp(-a)}
  equations: {a: 0}
  start: {a: 2}
  spread: {a: 0.1}
  integrator: {method: rk4, dt: 0.1}
recording: {twin: a, sensors: 1, reads: [light], noise: 0, duration: 4, every: 0.25}
"""
K = 0.4
TIMES = np.arange(0, 4.1, 0.25)


@pytest.mark.parametrize("unit", [1.0, 1e-6])
def test_an_equation_without_terms_has_the_rate_that_its_function_shows(
    tmp_path: Path, unit: float
) -> None:
    """A' = -k a changes the light by g exp(-a) k a, whatever the unit of time."""
    system, clock = laws.declared(tmp_path, FADING), TIMES / unit
    a = 2 * np.exp(-K * TIMES)
    segments = cut([clock], [1000 * np.exp(-a)[:, None]])
    sensors = StateSensors((Sensor("light", "light"),), system)
    assert sensors.fields.tolist() == [-1] and sensors.curved.tolist() == [0]
    nodes = 2 * np.exp(-K * segments.times[:, :1] * unit)
    scales = natural_scales(
        SegmentSimulator([system], segments, 1),
        sensors,
        [laws.term(system, "a", "a")],
        nodes,
        np.ones(1),
        np.full(1, 1e-3),
    )
    [rate], [coefficient] = scales.rate, scales.coefficient
    assert rate == pytest.approx(K * unit * np.sqrt(np.mean(np.square(a))), rel=0.5)
    assert coefficient == pytest.approx(K * unit, rel=0.5)


@pytest.mark.parametrize("seed", range(8))
def test_noise_that_hides_the_slopes_of_neighbours_leaves_a_rate(tmp_path: Path, seed: int) -> None:
    """The noise between two neighbours is eight times as large as the change of a wave."""
    system = laws.declared(tmp_path, FADING)
    times, rng = np.linspace(0, 50, 2001), np.random.default_rng(seed)
    readings = np.sin(times) + rng.normal(0, 0.1, times.shape)
    segments = cut([times], [readings[:, None]])
    scales = natural_scales(
        SegmentSimulator([system], segments, 1),
        StateSensors((Sensor("a", "a"),), system),
        [laws.term(system, "a", "a")],
        np.sin(segments.times[:, :1]),
        np.full(1, np.sqrt(0.5)),
        np.full(1, 0.1),
    )
    assert 0.4 < scales.rate[0] / np.sqrt(0.5) < 2.0
