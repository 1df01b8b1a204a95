"""``dashred.record``: what the sensors of a twin read, and nothing of its truth."""

from __future__ import annotations

from pathlib import Path

import pytest
import xarray as xr

import dashred
from tests.conftest import Ended


def test_it_is_the_recording_of_the_command(quick: Path, twin_run: Ended) -> None:
    ours = dashred.record(quick, twin="a", seed=0)
    path = twin_run.output / "recording.nc"
    xr.testing.assert_identical(ours, xr.load_dataset(path, engine="h5netcdf", decode_times=False))


def test_a_seed_and_overrides_are_taken(quick: Path) -> None:
    few = dashred.record(quick, "b", seed=1, overrides={"recording.duration": 2.0})
    assert float(few["time"][-1]) == 2.0


def test_a_twin_that_there_is_not(quick: Path, tmp_path: Path) -> None:
    with pytest.raises(dashred.InputError, match=r"has no twin 'z'(.|\n)*choose from: a, b, null"):
        dashred.record(quick, "z")
    (tmp_path / "quick.yaml").write_bytes(quick.read_bytes())
    with pytest.raises(dashred.InputError, match=r"quick has no twins(.|\n)*recording of your own"):
        dashred.record(tmp_path / "quick.yaml", "a")
