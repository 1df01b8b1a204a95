"""A result is saved as the command saves it, and comes back from either."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
import xarray as xr
from matplotlib.figure import Figure

import dashred
from tests.conftest import Ended

# The command's own beside them: the recording, the seal and the score of a twin.
OF_A_TWIN = {"recording.nc", "sealed.nc", "score.json"}


@pytest.fixture(scope="session")
def saved(result: dashred.Result, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return result.save(tmp_path_factory.mktemp("saved") / "out")


def test_the_files_are_those_of_the_command(saved: Path, twin_run: Ended) -> None:
    ours = {path.name for path in saved.iterdir()}
    command = {path.name for path in twin_run.output.iterdir()}
    command = {name for name in command if not name.endswith("_truth.png")}
    assert ours == command - OF_A_TWIN - {"rmse_against_time.png"}
    # The seed was given here, and there it was the default.
    corrected = (saved / "corrected.yaml").read_text().replace("seed: 0\n", "")
    assert corrected == twin_run.read("corrected.yaml").decode()
    assert (saved / "where.png").read_bytes() == twin_run.read("where.png")
    assert "linear damping" in (saved / "summary.txt").read_text()
    assert "mlflow_run" not in json.loads((saved / "run.json").read_text())


def test_it_comes_back(result: dashred.Result, saved: Path) -> None:
    again = dashred.load(saved)
    assert again.findings == result.findings
    assert (again.verdict, again.law) == (result.verdict, result.law)
    assert again.terms.equals(result.terms)
    assert again.estimates is not None and result.estimates is not None
    xr.testing.assert_identical(again.estimates, result.estimates)
    assert again.corrected is not None and result.corrected is not None
    ours, theirs = again.corrected.simulate(), result.corrected.simulate()
    np.testing.assert_allclose(ours["u"], theirs["u"], rtol=1e-5)
    assert isinstance(again.plot.where(), Figure)


def test_what_the_command_has_written_is_read(twin_run: Ended, tmp_path: Path) -> None:
    result = dashred.load(twin_run.output)
    assert result.verdict == "missing-term"
    assert result.corrected is not None and result.forecast is not None
    copy = dashred.load(result.save(tmp_path / "copy"))
    assert copy.findings == result.findings
    assert not {path.name for path in (tmp_path / "copy").iterdir()} & OF_A_TWIN


def test_a_result_takes_the_place_of_an_earlier_one(saved: Path, tmp_path: Path) -> None:
    result = dashred.load(saved)
    result.save(tmp_path)
    (tmp_path / "mine.txt").write_text("kept")
    result.save(tmp_path)
    result.save(saved)
    assert (tmp_path / "mine.txt").is_file() and (saved / "findings.json").is_file()


def test_files_of_another_origin_are_left_alone(result: dashred.Result, tmp_path: Path) -> None:
    (tmp_path / "report.html").write_text("mine")
    with pytest.raises(dashred.InputError, match="not written by dashred"):
        result.save(tmp_path)
    assert (tmp_path / "report.html").read_text() == "mine"


def test_a_folder_without_a_result_is_refused(tmp_path: Path) -> None:
    with pytest.raises(dashred.InputError, match="no such folder"):
        dashred.load(tmp_path / "none")
    with pytest.raises(dashred.InputError, match="have not been frozen"):
        dashred.load(tmp_path)


def test_a_changed_result_is_refused(saved: Path, tmp_path: Path) -> None:
    folder = dashred.load(saved).save(tmp_path / "changed")
    findings = (folder / "findings.json").read_text()
    (folder / "findings.json").write_text(findings.replace("missing-term", "parameter"))
    with pytest.raises(dashred.InputError, match="changed after it was frozen"):
        dashred.load(folder)
