"""A pulse that travels past some sensors of a line, and has not reached the others."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
import torch
from numpy.typing import NDArray

from dashred.data.recording import Recording
from dashred.data.sensors import Sensor
from dashred.pipeline.check import command
from dashred.pipeline.check.agreement import compare_amplitudes
from dashred.pipeline.check.recording_checks.unmoved import resting, unmoved, unmoved_remarks

TIMES = np.linspace(0.0, 3.0, 61)
PLACES = np.arange(1.0, 9.0)
NAMES = [f"s{x:.0f}" for x in PLACES]
SENSORS = tuple(Sensor(name, "u", (float(x),)) for name, x in zip(NAMES, PLACES, strict=True))
FRONT = ["s5", "s6", "s7", "s8"]
PULSE = """\
system:
  title: Pulse
  axes: {x: {length: 10, points: 128}}
  fields: {u: height}
  equations: {u: "-d(u, x)"}
  start: {u: "exp(-((x - 1)/0.3)**2)"}
  spread: {u: 0.02, length: 0.5}
recording: {path: pulse.csv, sensors: sensors.csv}
threads: 1
"""


def pulse(noise: float, digits: int) -> NDArray[np.float64]:
    """Return readings ``exp(-((x - 1 - t)/0.3)²)``, ``(time, sensor)``; the damping is slow."""
    clean = np.exp(-(((PLACES - 1 - TIMES[:, None]) / 0.3) ** 2) - 0.1 * TIMES[:, None])
    drawn = np.random.default_rng(1).standard_normal(clean.shape)
    rounded: NDArray[np.float64] = np.round(clean + noise * drawn, digits) + 0.0
    return rounded


def test_sensors_in_front_of_a_wave_are_told_from_those_that_it_passed() -> None:
    noisy = Recording(SENSORS, TIMES, pulse(0.005, 5))
    assert unmoved(noisy, np.full(8, 0.005)) == FRONT and not resting(noisy)
    rounded = Recording(SENSORS, TIMES, pulse(0.0, 2))
    assert unmoved(rounded, np.full(8, np.nan)) == FRONT
    assert resting(rounded) == dict.fromkeys(NAMES, 0.0)
    said = [*unmoved_remarks(rounded, FRONT, resting(rounded))]
    assert [remark.text for remark in said] == [
        "Constant throughout: s5, s6, s7, s8",
        "At one value for most of the record: s1, s2, s3, s4",
    ]


def test_a_sensor_that_is_stuck_where_no_other_rests_is_no_such_sensor() -> None:
    values = pulse(0.005, 5)
    values[20:, 1] = values[20, 1]
    alone = Recording((Sensor("v", "v"),), TIMES, np.full((61, 1), 0.5))
    assert not resting(Recording(SENSORS, TIMES, values))
    assert not resting(alone) and not unmoved(alone, np.array([np.nan]))


def test_readings_of_sensors_that_wait_are_not_compared() -> None:
    noise = dict.fromkeys(NAMES, 0.005)
    real = torch.from_numpy(pulse(0.005, 5))
    exact = torch.from_numpy(pulse(0.0, 12))
    said = [*compare_amplitudes(SENSORS, real, exact, noise, "simulator")]
    assert [remark.kind for remark in said] == ["ok"]
    for moved, still, where in ((real, exact[:40], "recording"), (exact[:40], exact, "simulator")):
        said = [*compare_amplitudes(SENSORS, moved, still, noise, "simulator")]
        assert [remark.kind for remark in said] == ["ok", "warning"]
        assert f"vary in the {where}, but not above the noise in the" in said[1].text
        assert said[1].text.startswith("Readings of s4 ")


def test_the_check_of_a_short_record_of_a_wave_has_nothing_to_complain_of(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    rows = np.column_stack([TIMES, pulse(0.002, 2)])
    np.savetxt(
        tmp_path / "pulse.csv", rows, "%.5f", ",", header=",".join(["time", *NAMES]), comments=""
    )
    places = "".join(f"{name},u,{x}\n" for name, x in zip(NAMES, PLACES, strict=True))
    (tmp_path / "sensors.csv").write_text("name,field,x\n" + places)
    (tmp_path / "pulse.yaml").write_text(PULSE)
    assert command.main([f"conf={tmp_path / 'pulse.yaml'}"]) == 0
    said = re.sub(r"\s+", " ", capsys.readouterr().out)
    assert "this is correct if nothing (no wave, for example) has reached them yet" in said
    assert "No errors and no warnings." in said
