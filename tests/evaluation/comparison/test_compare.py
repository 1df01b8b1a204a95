"""The command, on a system of seconds: real processes from the first row to the page."""

from __future__ import annotations

import json
import sqlite3
from pathlib import Path

import pytest

from dashred.core.errors import InputError
from dashred.evaluation import compare

PICTURES = ("space_time_truth", "rmse_against_time", "sparsity")


@pytest.mark.slow
def test_every_method_on_one_recording(
    quick: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = [f"systems={quick}", "twins=a", "noise=0.02", f"tracking.root={tmp_path / 'mlruns'}"]
    words += [f"output={tmp_path / 'out'}", f"document={tmp_path / 'docs' / 'results.md'}"]
    assert compare.main(words) == 0
    [row] = (tmp_path / "out" / "quick").iterdir()
    methods = json.loads((row / "compared.json").read_text())["methods"]
    for name in ("optimal_interpolation", "filter_state", "shred_plain", "corrected", "dashred"):
        assert 0 < methods[name]["rmse"] < 2
    for name in ("pde_find", "filter_augmented", "latent_alg1", "latent_alg2", "corrected"):
        assert methods[name]["found"] + methods[name]["missed"] == 1
    assert methods["closed_form"]["rmse"] is None
    page = (tmp_path / "docs" / "results.md").read_text()
    assert "ensemble Kalman filter" in page and "figures/results_quick_space_time_truth.png" in page
    pictures = {file.name for file in (tmp_path / "docs" / "figures").iterdir()}
    assert pictures >= {f"results_quick_{n}.png" for n in PICTURES}
    logged = sqlite3.connect(tmp_path / "mlruns" / "mlflow.db")
    [[names]] = logged.execute(
        "select count(*) from metrics where key in ('rmse/filter_state', 'rmse/corrected')"
    )
    assert names == 2

    capsys.readouterr()
    before = (row / "compared.json").stat().st_mtime_ns
    assert compare.main(words) == 0
    assert (row / "compared.json").stat().st_mtime_ns == before
    assert "other methods: 0 of 1 rows to do" in capsys.readouterr().out


def test_unknown_words_are_refused_and_help_is_given(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(InputError, match="unknown key"):
        compare.main(["systems=rde", "documents=x"])
    with pytest.raises(SystemExit):
        compare.main(["--help"])
    assert "usage: dashred compare systems=SYSTEM" in capsys.readouterr().out
