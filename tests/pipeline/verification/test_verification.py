"""Verification: errors in the units they claim, and the refusal of an unresolved simulator."""

from __future__ import annotations

import numpy as np
import pytest
import torch
import xarray as xr

from dashred.config import load_config
from dashred.physics.runs.resolution import Resolution
from dashred.physics.system import System
from dashred.pipeline.input.build_problem import build_problem
from dashred.pipeline.outputs import field_files
from dashred.pipeline.verification import held_out, verification
from dashred.pipeline.verification.findings_input import build_input


@pytest.fixture(scope="module")
def problem(quick, twin_run):
    path = twin_run.output / "recording.nc"
    return build_problem(load_config([f"conf={quick}", f"recording.path={path}"], entry="train"))


def test_a_refusal_names_the_points_that_would_do(problem) -> None:
    found = verification.unresolved_findings(problem, Resolution(0.034, 0.01, 2))
    assert found["verdict"] == "unresolved-numerics" and found["causes"] is not None
    [cause] = found["causes"]
    assert cause["enough"] == {"x": 64}
    for part in ("3.4 %", "1.0 %", "64", "would be enough"):
        assert part in cause["says"]
    assert found["terms"] is None and found["latent"]["alg1"] is None


def test_a_refusal_says_so_when_twice_the_points_are_not_enough(problem) -> None:
    found = verification.unresolved_findings(problem, Resolution(0.5, 0.01, None))
    assert found["causes"] is not None
    assert found["causes"][0]["enough"] is None
    assert "doubling it twice is not enough" in found["causes"][0]["says"]


def test_errors_count_in_stds_of_each_trace_and_pass_over_missing_samples() -> None:
    recorded = np.array([[0.0, 10.0], [np.nan, 30.0]])
    read = np.array([[1.0, 10.0], [7.0, 50.0]])
    error = held_out.relative_rmse(read, recorded, np.array([1.0, 10.0]))
    assert error == pytest.approx(np.sqrt((1 + 0 + 4) / 3))


def test_a_run_that_blows_up_has_no_error_rather_than_a_small_one() -> None:
    recorded = np.array([[0.0], [1.0], [np.nan]])
    lost = np.array([[0.0], [np.nan], [np.nan]])
    assert not np.isfinite(held_out.relative_rmse(lost, recorded, np.ones(1)))
    assert held_out.relative_rmse(lost[:1], recorded[:1], np.ones(1)) == 0.0
    assert np.isnan(held_out.relative_rmse(lost[2:], recorded[2:], np.ones(1)))


def test_estimates_are_written_by_method_on_the_grid(problem, tmp_path) -> None:
    system: System = problem.system
    times = problem.times[:4]
    states = torch.arange(4 * 32, dtype=torch.float32).reshape(4, 1, 32)
    path = tmp_path / "estimates.nc"
    field_files.write_estimates(path, system, times, {"shred": states, "dashred": 2 * states})
    with xr.open_dataset(path, engine="h5netcdf") as written:
        assert written["u"].dims == ("method", "time", "x")
        assert written["u"].dtype == np.float64
        np.testing.assert_array_equal(written["u"].sel({"method": "dashred"}), 2 * states[:, 0])
        np.testing.assert_allclose(written["x"], 2 * np.pi * np.arange(32) / 32)
    assert [file.name for file in tmp_path.iterdir()] == ["estimates.nc"]


def test_the_sources_name_every_sensor_once(problem) -> None:
    splits = build_input(problem)["splits"]
    assert splits is not None
    roles = [splits["inputs"], splits["extra"], splits["validate"], splits["test"]]
    assert sorted(name for role in roles for name in role) == [f"s{i}" for i in range(1, 7)]
    assert [len(role) for role in roles] == [3, 1, 1, 1]
