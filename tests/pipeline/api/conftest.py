"""One recording of the quick system, and one result, for all tests of the API."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import xarray as xr

import dashred
from tests.conftest import Ended


@pytest.fixture(scope="session")
def recorded(twin_run: Ended) -> xr.Dataset:
    """The recording that the command has analysed, as it lies in its file."""
    return xr.load_dataset(twin_run.output / "recording.nc", engine="h5netcdf", decode_times=False)


@pytest.fixture(scope="session")
def result(quick: Path, recorded: xr.Dataset) -> dashred.Result:
    """What is found from it at seed 0."""
    return dashred.Problem.from_yaml(quick, recording=recorded).discover(seed=0, progress=False)


@pytest.fixture
def frame(recorded: xr.Dataset) -> pd.DataFrame:
    """The recording as a table."""
    columns = dict(zip(recorded["name"].values, recorded["value"].values.T, strict=True))
    return pd.DataFrame({"time": recorded["time"].values, **columns})


@pytest.fixture
def places(recorded: xr.Dataset) -> pd.DataFrame:
    """The table of its sensors."""
    names, reads = recorded["name"].values, recorded["reads"].values
    x, std = recorded["x"].values, recorded["std"].values
    return pd.DataFrame({"name": names, "field": reads, "x": x, "std": std})


@pytest.fixture
def swing() -> pd.DataFrame:
    """A damped pendulum's angle, with 1 % noise."""
    times = 0.05 * np.arange(200)
    rng = np.random.default_rng(0)
    theta = np.exp(-0.05 * times) * np.cos(8 * times) + 0.01 * rng.standard_normal(200)
    return pd.DataFrame({"time": times, "theta": theta})
