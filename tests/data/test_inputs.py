"""Input signals of twins: sampled past the end of the recording, written and read."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch

from dashred.config import load_config
from dashred.core.errors import InputError
from dashred.data.inputs import drive_signals, with_inputs
from dashred.data.io.reader import read_recording
from dashred.data.io.write_netcdf import write_netcdf
from dashred.data.recording import Recording
from dashred.data.sensors import Sensor
from dashred.evaluation.twins.recorder import DURATION_FACTOR, truth_times
from dashred.physics.system import System


@pytest.fixture
def circuit():
    config = load_config(["conf=rlc", "twin=null"], entry="record")
    return System(config.system, config.where), config


def test_a_drive_is_known_as_far_as_forecasts_go(circuit) -> None:
    system, config = circuit
    times = truth_times(config)
    inputs = drive_signals(system, config, times)
    t = times.numpy()
    assert t[-1] == pytest.approx(DURATION_FACTOR * config.recording.duration)
    expected = 0.5 * np.sin(1.1 * t) + 0.3 * np.sin(2.3 * t)
    np.testing.assert_allclose(inputs.values["voltage"], expected, atol=1e-12)
    [now] = with_inputs(system, inputs).input_signals.at(float(t[7])).values()
    assert float(now) == pytest.approx(expected[7])


def test_inputs_are_written_on_their_own_clock_and_read_again(circuit, tmp_path: Path) -> None:
    system, config = circuit
    times = truth_times(config)
    inputs = drive_signals(system, config, times)
    count = 21
    values = torch.zeros((count, 1)).double().numpy()
    recording = Recording((Sensor("s1", "Q", (), 0.1),), times[:count].numpy(), values, inputs)
    write_netcdf(recording, tmp_path / "r.nc")
    again = read_recording(str(tmp_path / "r.nc"), None, system)
    assert len(again.times) == count and again.sha256() == recording.sha256()
    np.testing.assert_array_equal(again.inputs.times, inputs.times)
    np.testing.assert_array_equal(again.inputs.values["voltage"], inputs.values["voltage"])


@pytest.mark.parametrize(
    ("drive", "problem"),
    [({}, "has no drive"), ({"voltage": "0.5*Q"}, "may depend on t only")],
)
def test_an_input_without_a_drive_of_time_is_refused(circuit, drive, problem) -> None:
    system, config = circuit
    bare = replace(config, recording=replace(config.recording, drive=drive))
    with pytest.raises(InputError, match=problem):
        drive_signals(system, bare, truth_times(config))
