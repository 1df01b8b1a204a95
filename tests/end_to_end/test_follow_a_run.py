"""A field is followed with the folder that an analysis has left."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import torch

import dashred
from dashred.data.observation_operator import ObservationOperator
from dashred.pipeline.follow import command
from dashred.pipeline.follow.finished_run import read_run
from tests.conftest import Ended

SAMPLES, BEGINS = 240, 120


@pytest.mark.slow
def test_a_field_is_followed_and_a_drifting_sensor_named(
    twin_run: Ended, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    run = read_run(twin_run.output)
    simulator = dashred.load(twin_run.output).corrected
    assert simulator is not None
    times = 0.1 * np.arange(SAMPLES)
    fields = torch.from_numpy(simulator.simulate(times=times)["u"].to_numpy())[:, None]
    truth = ObservationOperator(run.sensors, run.system)(fields).numpy()
    noise = run.noise * np.random.default_rng(0).standard_normal(truth.shape)
    values = truth + noise
    values[BEGINS:, 0] += 0.1 * run.noise[0] * np.arange(SAMPLES - BEGINS)
    stream, out = tmp_path / "s.csv", tmp_path / "o.csv"
    pd.DataFrame({"time": times, **dict(zip(run.names, values.T, strict=True))}).to_csv(
        stream, index=False
    )
    words = [f"run={twin_run.output}", f"source={stream}", f"output={out}", "idle=0", "at=u@1"]
    assert command.main(words) == 0
    table = pd.read_csv(out)
    assert len(table) == SAMPLES and table["alarm"][:BEGINS].isna().all()
    for index, name in enumerate(run.names):
        error = table[f"{name}.filter"][40:BEGINS] - truth[40:BEGINS, index]
        assert error.std() < run.noise[index]
    assert np.isfinite(table[["u@1.filter", "u@1.shred"]].to_numpy()).all()
    assert table["alarm"][BEGINS:].notna().any()
    assert f"{run.names[0]} differs" in capfd.readouterr().err
