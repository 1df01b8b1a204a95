"""What is found in Python is what the command finds, and can be looked at."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
import torch
import xarray as xr

import dashred
from tests.conftest import Ended


def test_the_findings_are_those_of_the_command(result: dashred.Result, twin_run: Ended) -> None:
    command, ours = (
        json.loads(twin_run.read("findings.json")),
        json.loads(json.dumps(result.findings)),
    )
    # The recording in memory has no file, whose name is part of the configuration's hash.
    for findings in (command, ours):
        del findings["input"]["config"]["recording"]["path"]
        del findings["input"]["config_sha256"]
    assert ours == command


def test_a_recording_in_a_file_gives_the_same_configuration(quick: Path, twin_run: Ended) -> None:
    from dashred.config import config_sha256

    problem = dashred.Problem.from_yaml(quick, recording=twin_run.output / "recording.nc")
    command = json.loads(twin_run.read("findings.json"))["input"]
    assert config_sha256(problem.config) == command["config_sha256"]


@pytest.mark.parametrize("name", ["estimates", "forecast"])
def test_the_fields_are_those_of_the_command(
    result: dashred.Result, twin_run: Ended, name: str
) -> None:
    command = xr.load_dataset(twin_run.output / f"{name}.nc", engine="h5netcdf")
    xr.testing.assert_allclose(getattr(result, name), command, rtol=1e-6)


def test_the_law_is_told_in_words_and_as_a_table(result: dashred.Result) -> None:
    assert result.verdict == "missing-term"
    assert "linear damping" in result.law
    [term] = result.terms.to_dict("records")
    assert (term["equation"], term["term"]) == ("u", "u")
    assert term["low"] < -0.1 < term["high"]
    assert result.fitted_parameters.empty
    assert {"law", "delta_bic", "rival"} <= set(result.alternatives.columns)
    assert len(result.alternatives) == len(result.findings["alternatives"])


def test_it_shows_itself(result: dashred.Result) -> None:
    assert repr(result).startswith("<dashred.Result missing-term: ")
    assert "Verdict: missing-term" in str(result)
    page = result._repr_html_()
    assert page.startswith('<div class="dashred">') and "linear damping" in page
    assert "<mark>" in page


def test_the_corrected_simulator_starts_where_the_fit_does(result: dashred.Result) -> None:
    assert result.corrected is not None and result.estimates is not None
    found = result.estimates.sel({"method": "corrected"})["u"]
    ours = result.corrected.simulate()["u"]
    np.testing.assert_allclose(ours, found, rtol=1e-9)
    assert "0.1006" in result.corrected.equations["u"]


def test_the_corrected_simulator_goes_on_from_any_state(result: dashred.Result) -> None:
    assert result.corrected is not None and result.estimates is not None
    corrected = result.corrected
    middle = result.estimates.sel({"method": "corrected"}).isel(time=10)
    on = corrected.simulate(start=middle, times=result.estimates["time"][10:])
    whole = corrected.simulate()
    np.testing.assert_allclose(on["u"], whole["u"][10:], rtol=1e-6)


def test_nothing_of_the_process_is_left_changed(quick: Path, recorded: xr.Dataset) -> None:
    torch.manual_seed(7)
    torch.set_num_threads(2)
    # Another test of this process may have run an analysis, which needs deterministic algorithms.
    torch.use_deterministic_algorithms(False)
    try:
        before = torch.random.get_rng_state()
        dashred.Problem.from_yaml(quick, recording=recorded).check()
        assert torch.get_num_threads() == 2
        assert not torch.are_deterministic_algorithms_enabled()
        assert torch.equal(torch.random.get_rng_state(), before)
    finally:
        torch.set_num_threads(1)
