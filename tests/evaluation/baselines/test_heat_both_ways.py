"""The general pipeline against the closed form of a linear system: the same answer to the noise."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
import xarray as xr

from dashred import train
from dashred.config import load_config
from dashred.evaluation.baselines.closed_form import closed_form
from dashred.evaluation.twins import record_command
from dashred.pipeline.input.build_problem import build_problem
from dashred.pipeline.simulation.nominal_run import simulate_nominal

# Networks have no part in what is compared.
SMALL = (
    "simulation.members=24",
    "simulation.held_out=4",
    "shred.epochs=2",
    "surrogate.members=8",
)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("twin", "seed", "general", "linear"), [("a", 5, "T", "T"), ("b", 6, "kappa", "d(T, x, 2)")]
)
def test_both_find_the_same_law_and_the_same_field(
    twin: str, seed: int, general: str, linear: str, tmp_path: Path
) -> None:
    told = ["conf=heat", f"recording.twin={twin}", f"seed={seed}", f"output={tmp_path}"]
    assert record_command.main(told) == 0
    reads = ["conf=heat", f"recording.path={tmp_path / 'recording.nc'}"]
    problem = build_problem(load_config(reads, entry="train"))
    exact = closed_form(problem, simulate_nominal(problem, {}).prior)
    assert exact is not None and exact.terms is not None
    out = tmp_path / "general"
    root = f"tracking.root={tmp_path / 'mlruns'}"
    assert train.main([*reads, *SMALL, root, f"output={out}"]) == 0
    findings = json.loads((out / "findings.json").read_text())
    [entry], [other] = findings["terms"], exact.terms
    # A change of κ is that of the term it multiplies: kappa*lap(T).
    assert (entry.get("parameter", entry["term"]), other["term"]) == (general, linear)
    assert abs(entry["coefficient"] - other["coefficient"]) < 0.1 * entry["std"]
    with xr.open_dataset(out / "estimates.nc", engine="h5netcdf") as estimates:
        found = estimates["T"].sel({"method": "corrected"}).values
    difference = found - exact.states[:, 0, : found.shape[1]].numpy()
    noise = float(problem.noise_of(problem.split.fit.names).mean())
    assert float(np.sqrt(np.mean(difference**2))) < 0.02 * noise
