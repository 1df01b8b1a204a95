"""Whole runs with uncertain parameters: they are fitted, and are no discovery."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from tests.pipeline.whole_runs.test_episodes_run import (
    OSCILLATOR,
    SIGMA,
    STARTS,
    damped,
    findings_of,
)

pytestmark = pytest.mark.slow

# The exact oscillator has k/m = 2 and a damping of 0.15.
PARAMETERS = "{k: 2.0}\n  equations: {x: p, p: -k*x}"
MISSING = "{k: 2.0, m: {value: 1.5, spread: 0.5}}\n  equations: {x: p, p: -k*x/m}"
COMPLETE = (
    "{k: {value: 1.6, spread: 0.4}, b: {value: 0.1, spread: 0.1}}\n"
    "  equations: {x: p, p: -k*x - b*p}"
)


def recorded(path: Path) -> None:
    """Write the readings of three episodes; the last is held out as a whole."""
    rng = np.random.default_rng(8)
    lines = ["time,episode,x,p"]
    for name, start, begin, count in STARTS:
        passed = 0.1 * np.arange(count)
        read = damped(start, passed) + SIGMA * rng.standard_normal((count, 2))
        lines += [
            f"{begin + t:.7g},{name},{x:.6f},{p:.6f}"
            for t, (x, p) in zip(passed, read, strict=True)
        ]
    path.write_text("\n".join(lines) + "\n")


def run(train: Any, folder: Path, parameters: str) -> tuple[dict[str, Any], Any]:
    recorded(folder / "r.csv")
    config = folder / "oscillator.yaml"
    config.write_text(OSCILLATOR.replace(PARAMETERS, parameters))
    ended = train(f"conf={config}", f"recording.path={folder / 'r.csv'}", figures=True)
    return findings_of(ended), ended


def test_a_missing_term_beside_an_uncertain_divisor(train, tmp_path: Path) -> None:
    found, ended = run(train, tmp_path, MISSING)
    assert found["verdict"] == "missing-term"
    [term] = found["terms"]
    assert (term["equation"], term["term"]) == ("p", "p")
    assert term["ci95"][0] < -0.15 < term["ci95"][1]
    [fitted] = found["fitted_parameters"]
    assert (fitted["parameter"], fitted["stated"], fitted["spread"]) == ("m", 1.5, 0.5)
    assert fitted["ci95"][0] < 1.0 < fitted["ci95"][1] and fitted["std"] < 0.02
    assert fitted["aliases"] == ["k"]
    held = found["fit"]["heldout_episode"]
    assert held["corrected"] < 0.3 * held["simulation_refit"]
    assert "m = " in ended.out and "stated 1.5, spread 0.5" in ended.out
    corrected = yaml.safe_load(ended.read("corrected.yaml"))["system"]
    assert corrected["parameters"]["m"] == pytest.approx(fitted["value"])
    assert "parameter_spread" not in corrected


def test_nothing_is_missing_with_fitted_parameters(train, tmp_path: Path) -> None:
    found, ended = run(train, tmp_path, COMPLETE)
    assert found["verdict"] == "nothing-missing" and found["terms"] == []
    values = {each["parameter"]: each for each in found["fitted_parameters"]}
    for name, truth in (("k", 2.0), ("b", 0.15)):
        low, high = values[name]["ci95"]
        assert low < truth < high and values[name]["std"] < 0.02
    # The simulator as it is stated misses the recording.
    time = found["fit"]["heldout_time"]
    assert time["corrected"] < 0.3 * time["simulation"]
    assert "with the fitted parameters" in ended.out
    corrected = yaml.safe_load(ended.read("corrected.yaml"))["system"]
    assert corrected["parameters"]["b"] == pytest.approx(values["b"]["value"])
