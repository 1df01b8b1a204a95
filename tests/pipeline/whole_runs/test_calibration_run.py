"""A whole run with sensors that are not calibrated: they are fitted, and are no discovery."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from tests.pipeline.whole_runs.test_episodes_run import SMALL, findings_of

pytestmark = pytest.mark.slow

CELL = f"""\
system:
  title: a cell
  fields: {{v: polarisation, q: charge}}
  parameters: {{ocv: 3.8, R0: {{value: 0.03, spread: 0.03}}, R1: 0.03, tau: 25, k: 0.004}}
  inputs: {{I: {{column: amp, hold: true}}}}
  let: {{U: ocv - k*q - R0*I - v}}
  equations: {{v: (R1*I - v)/tau, q: I}}
  start: {{v: 0, q: 0}}
  spread: {{v: 0.01, q: 0.1}}
  integrator: {{method: rk4, dt: 1}}
library: {{v: [v, I, "1"]}}
recording: {{path: cell.csv, calibration: {{U: {{gain: 0.1, offset: fitted}}}}}}
{SMALL}"""
R0, GAIN, OFFSET, SIGMA = 0.05, 1.05, -0.1, 0.002


def record(path: Path) -> None:
    """Write the exact readings of a cell under steps of current, with noise."""
    rng = np.random.default_rng(3)
    count = 260
    amp = np.repeat(rng.choice([0, 1, 2, -1, 0.5], size=count // 10), 10)
    v, q = np.zeros(count), np.concatenate([[0.0], np.cumsum(amp)[:-1]])
    decay = np.exp(-1 / 25)
    for i in range(1, count):
        v[i] = v[i - 1] * decay + 0.03 * amp[i - 1] * (1 - decay)
    exact = GAIN * (3.8 - 0.004 * q - R0 * amp - v) + OFFSET
    read = exact + SIGMA * rng.standard_normal(count)
    columns = np.column_stack([np.arange(count), read, amp])
    np.savetxt(path, columns, "%.7g", ",", header="time,U,amp", comments="")


def test_gain_offset_and_a_resistance_that_only_a_sensor_sees(train: Any, tmp_path: Path) -> None:
    record(tmp_path / "cell.csv")
    (tmp_path / "cell.yaml").write_text(CELL)
    ended = train(f"conf={tmp_path / 'cell.yaml'}")
    found = findings_of(ended)
    assert found["verdict"] == "nothing-missing" and found["terms"] == []
    fitted = {each["parameter"]: each for each in found["fitted_parameters"]}
    truths = {"R0": R0, "gain_of_U": GAIN, "offset_of_U": OFFSET}
    assert fitted.keys() == truths.keys()
    for name, truth in truths.items():
        assert abs(fitted[name]["value"] - truth) < 3 * fitted[name]["std"]
    assert fitted["R0"]["std"] < 0.001 and fitted["gain_of_U"]["std"] < 0.005
    assert fitted["gain_of_U"]["sensor"] == "U" and "sensor" not in fitted["R0"]
    assert "This calibrates the sensor U." in ended.out
    corrected = yaml.safe_load(ended.read("corrected.yaml"))
    assert "calibration" not in corrected.get("recording", {})
    assert corrected["system"]["parameters"].keys() == {"ocv", "R0", "R1", "tau", "k"}
    assert corrected["system"]["let"].keys() == {"U"}
