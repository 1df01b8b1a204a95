"""Sensors that average over an interval of time, or over a region."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch

from dashred.core.errors import InputError
from dashred.data.episodes import Episode, Episodes
from dashred.data.observation_operator import ObservationOperator
from dashred.data.recording import Recording
from dashred.data.sensors import Sensor
from dashred.data.stated.averages import with_averages
from dashred.physics.system import System
from tests import laws

TEXT = """
system:
  title: an oscillator
  fields: {x: place, p: momentum}
  parameters: {k: 2.0}
  inputs: {e: volt}
  let: {energy: p**2 + k*x**2, both: p + 0*t}
  equations: {x: p, p: -k*x}
  start: {x: 1, p: 0}
  integrator: {dt: 0.1}
recording: {path: a.csv}
"""
RING = """
system:
  title: a ring
  axes: {x: {length: 2*pi, points: 32, ends: ENDS}}
  fields: {u: amount}
  equations: {u: lap(u)}
  start: {u: 1}
  integrator: {dt: 0.1, space: SPACE}
recording: {path: a.csv}
"""
OMEGA, STEP = np.sqrt(2.0), 0.5
TIMES = np.linspace(0.5, 19.5, 39)


def recorded(*names: str, gap: bool = False) -> Episodes:
    times = np.delete(TIMES, slice(5, 9)) if gap else TIMES
    sensors = tuple(Sensor(name, name) for name in names)
    return Episodes(
        (Episode("", Recording(sensors, times, np.column_stack([times] * len(names)))),)
    )


def at(times: np.ndarray) -> torch.Tensor:
    """Return the exact states, ``(time, field)``."""
    return torch.from_numpy(
        np.stack([np.cos(OMEGA * times), -OMEGA * np.sin(OMEGA * times)], axis=1)
    )


def test_a_mean_is_read_at_the_middle_of_its_interval(tmp_path: Path) -> None:
    """The error is of order T⁴: 6e-4 of the amplitude at nine samples in a period."""
    system, found = with_averages(
        laws.declared(tmp_path, TEXT), recorded("x", gap=True), "interval", str
    )
    [part] = found.episodes
    [sensor], times = part.recording.sensors, part.recording.times
    np.testing.assert_allclose(times + STEP / 2, part.recording.values[:, 0])
    exact = (np.sin(OMEGA * (times + STEP / 2)) - np.sin(OMEGA * (times - STEP / 2))) / OMEGA / STEP
    read = system.evaluate(sensor.reads, at(times)).numpy()
    np.testing.assert_allclose(read, exact, atol=2e-4)
    assert np.abs(at(times)[:, 0].numpy() - exact).max() > 0.02


def test_a_mean_of_a_let_and_an_instantaneous_sensor(tmp_path: Path) -> None:
    bare = laws.declared(tmp_path, TEXT)
    system, found = with_averages(bare, recorded("x", "energy"), {"energy": 0.5}, str)
    [part] = found.episodes
    assert part.recording.times.tolist() == [0.25 * n for n in range(1, 79)]
    seen = np.isfinite(part.recording.values)
    assert seen[1::2, 0].all() and seen[::2, 1].all() and seen.sum() == 2 * len(TIMES)
    # The energy is constant along the equations.
    name = part.recording.sensors[1].reads
    assert float(system.evaluate(name, at(np.array([0.3])))) == pytest.approx(2.0)


def test_readings_that_are_not_averages_stay(tmp_path: Path) -> None:
    system, episodes = laws.declared(tmp_path, TEXT), recorded("x")
    assert with_averages(system, episodes, None, str) == (system, episodes)


def test_what_cannot_be_an_average(tmp_path: Path) -> None:
    system, uneven = laws.declared(tmp_path, TEXT), recorded("x")
    recording = uneven.episodes[0].recording
    times = recording.times + np.where(np.arange(39) % 2, 0.1, 0.0)
    shaken = Episodes((Episode("", replace(recording, times=times)),))
    for stated, episodes, what in (
        ("mean", uneven, "must be a positive number or interval"),
        ({"x": 0}, uneven, "recording.average.x is 0"),
        ({"y": 1}, uneven, "names 'y', but no sensor"),
        ("interval", shaken, "has no common interval"),
    ):
        with pytest.raises(InputError, match=what):
            with_averages(system, episodes, stated, str)
    ring = laws.declared(tmp_path, RING.replace("ENDS", "periodic").replace("SPACE", "spectral"))
    two = Episodes(
        (
            Episode(
                "",
                Recording(
                    (Sensor("a", "u", (1.0,)), Sensor("b", "u", (2.0,))), TIMES, np.ones((39, 2))
                ),
            ),
        )
    )
    with pytest.raises(InputError, match="average over different times"):
        with_averages(ring, two, {"a": 0.5}, str)


def ring(folder: Path, ends: str, space: str) -> System:
    return laws.declared(folder, RING.replace("ENDS", ends).replace("SPACE", space))


@pytest.mark.parametrize(
    ("ends", "space", "error"),
    [
        ("periodic", "spectral", 1e-12),
        ("insulated", "spectral", 1e-12),
        ("periodic", "finite-difference", 0.02),
    ],
)
def test_the_mean_over_a_region(tmp_path: Path, ends: str, space: str, error: float) -> None:
    system = ring(tmp_path, ends, space)
    place, width = 2.0, 1.5
    sensors = Sensor("a", "u", (place,), widths=(width,)), Sensor("b", "u", (place,))
    operator = ObservationOperator(sensors, system)
    x = system.grid.coordinates["x"]
    read, point = operator(torch.cos(3 * x)[None]).tolist()
    low, high = place - width / 2, place + width / 2
    exact = (np.sin(3 * high) - np.sin(3 * low)) / 3 / width
    assert read == pytest.approx(exact, abs=error)
    assert point == pytest.approx(np.cos(3 * place), abs=0.05)


def test_a_region_stays_within_the_axis(tmp_path: Path) -> None:
    wide = Sensor("a", "u", (0.5,), widths=(1.5,))
    ObservationOperator([wide], ring(tmp_path, "periodic", "spectral"))
    with pytest.raises(InputError, match="averages beyond an end of the axis x"):
        ObservationOperator([wide], ring(tmp_path, "insulated", "spectral"))
    with pytest.raises(InputError, match="x_width is 7"):
        too_wide = replace(wide, widths=(7.0,))
        ObservationOperator([too_wide], ring(tmp_path, "periodic", "spectral"))
