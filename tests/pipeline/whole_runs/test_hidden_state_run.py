"""A whole run in which a state is missing from the equations: the wall of a mug."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from tests.pipeline.discovery.segments.test_hidden_state_stage import GAIN, MUG, TAU, TIMES, water
from tests.pipeline.whole_runs.test_episodes_run import SMALL, findings_of

pytestmark = pytest.mark.slow

# Name, water and wall at the first sample: the second cup is poured into the warm mug.
POURED = [("first", 90.0, 22.0), ("second", 80.0, 45.0)]


def recorded(path: Path) -> None:
    """Write the readings of two episodes."""
    rng, lines = np.random.default_rng(4), ["time,episode,T"]
    for name, first, wall in POURED:
        read = water(GAIN, first, wall) + 0.1 * rng.standard_normal(len(TIMES))
        lines += [f"{t:.7g},{name},{T:.6f}" for t, T in zip(TIMES, read, strict=True)]
    path.write_text("\n".join(lines) + "\n")


def test_the_wall_of_a_mug_is_told_and_simulated(train: Any, tmp_path: Path) -> None:
    recorded(tmp_path / "recording.csv")
    own = MUG.replace("spread: {T: 5}", "spread: {T: 10}").split("splits:")[0]
    (tmp_path / "mug.yaml").write_text(own + SMALL)
    words = (f"conf={tmp_path / 'mug.yaml'}", f"recording.path={tmp_path / 'recording.csv'}")
    ended = train(*words, figures=True)
    found = findings_of(ended)
    assert found["verdict"] == "outside-library" and found["fitted_parameters"] == []
    told = found["hidden_state"]
    assert told["time_constant_ci95"][0] < TAU < told["time_constant_ci95"][1]
    assert told["gain_ci95"][0] < GAIN < told["gain_ci95"][1]
    assert "A hidden state z relaxes toward T with a time constant τ of" in ended.out
    assert "a law with a hidden state does" in ended.out
    corrected = yaml.safe_load(ended.read("corrected.yaml"))["system"]
    assert corrected["equations"]["z"] == "(T - z)/tau_z"
    assert corrected["parameters"]["tau_z"] == pytest.approx(told["time_constant"])
    assert corrected["start"]["z"] == pytest.approx(22, abs=5)
    held = found["fit"]["heldout_restarted"]
    assert held["corrected"] < 0.5 * held["simulation_refit"]
    assert b"dz/dt" in ended.read("report.html")
