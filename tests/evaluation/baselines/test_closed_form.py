"""The closed form of linear systems: exact where it must be, and none where it does not hold."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
import torch
import xarray as xr

from dashred.config import load_config
from dashred.evaluation.baselines.closed_form import Traces, closed_form, eigenvalues, fit_modes
from dashred.evaluation.twins import record_command
from dashred.physics.runs.initial_state_prior import StartPrior, gaussian_process_modes
from dashred.physics.system import System
from dashred.pipeline.input.build_problem import build_problem
from dashred.pipeline.problem import Problem
from dashred.pipeline.simulation.nominal_run import simulate_nominal

RATES = -torch.tensor([0.0, 0.05, 0.2, 0.45], dtype=torch.float64)
PLACES = torch.tensor([0.7, 2.9, 4.2, 6.1, 8.8], dtype=torch.float64)
READINGS = torch.stack([torch.cos(n * math.pi * PLACES / 10) for n in range(4)])
TIMES = 0.2 * torch.arange(51, dtype=torch.float64)
AMPLITUDES = torch.tensor([1.2, 0.8, -0.4, 0.6], dtype=torch.float64)
SHIFTS = torch.tensor([-0.04, -0.05, -0.06, -0.08], dtype=torch.float64)


def traces(noise: float, seed: int = 0) -> Traces:
    """Return what five sensors record of four decaying modes, one sample missing."""
    grown = torch.exp((RATES + SHIFTS) * TIMES[:, None]) * AMPLITUDES
    rng = np.random.default_rng(seed)
    values = grown @ READINGS + noise * torch.from_numpy(rng.standard_normal((51, 5)))
    values[7, 2] = torch.nan
    std = torch.full((5,), max(noise, 1e-6), dtype=torch.float64)
    return Traces(READINGS, RATES, torch.ones(4, dtype=torch.float64), TIMES, values, std)


def problem_and_prior(name: str, recording: Path) -> tuple[Problem, StartPrior]:
    config = load_config([f"conf={name}", f"recording.path={recording}"], entry="test")
    found = build_problem(config)
    return found, simulate_nominal(found, {}).prior


def test_rates_and_amplitudes_are_exact_without_noise() -> None:
    found = fit_modes(traces(0.0), torch.eye(4, dtype=torch.float64))
    torch.testing.assert_close(found.shifts, SHIFTS, rtol=0, atol=1e-6)
    torch.testing.assert_close(found.amplitudes, AMPLITUDES, rtol=0, atol=1e-6)


def test_error_bars_are_right() -> None:
    """Over 40 draws of the noise the shift's error in standard deviations has an rms near 1."""
    shapes = torch.stack([torch.ones(4, dtype=torch.float64), RATES], dim=1)
    z = []
    for seed in range(40):
        found = fit_modes(traces(0.02, seed), torch.eye(4, dtype=torch.float64))
        z.append((found.shifts - SHIFTS) / found.covariance.diagonal().sqrt())
    assert 0.8 < float(torch.stack(z).square().mean().sqrt()) < 1.2
    few = fit_modes(traces(0.02), shapes)
    assert few.shifts.shape == (4,) and few.coefficients.shape == (2,)


@pytest.mark.parametrize("ends", ["insulated", "fixed", "periodic"])
def test_eigenvalues_of_a_laplacian(ends: str, tmp_path: Path) -> None:
    system = declared(tmp_path, ends, "0.5*lap(T) - 0.1*T")
    modes = gaussian_process_modes(system.grid, 1.0, 5)
    found = eigenvalues(system, system.resolved["T"], modes)
    assert found is not None
    step = 2 * math.pi / 10 if ends == "periodic" else math.pi / 10
    numbers = {"periodic": [0, 1, 1, 2, 2], "fixed": [1, 2, 3, 4, 5]}.get(ends, range(5))
    exact = torch.tensor([-0.5 * (n * step) ** 2 - 0.1 for n in numbers], dtype=torch.float64)
    torch.testing.assert_close(found, exact, rtol=0, atol=1e-10)


def test_waves_that_travel_are_no_eigenfunctions(tmp_path: Path) -> None:
    system = declared(tmp_path, "periodic", "0.5*lap(T) - 0.1*d(T, x)")
    modes = gaussian_process_modes(system.grid, 1.0, 5)
    assert eigenvalues(system, system.resolved["T"], modes) is None


def declared(folder: Path, ends: str, equation: str) -> System:
    path = folder / "bar.yaml"
    path.write_text(
        "system:\n  title: bar\n"
        f"  axes: {{x: {{length: 10, points: 32, ends: {ends}}}}}\n"
        f"  fields: {{T: temperature}}\n  equations: {{T: '{equation}'}}\n"
        "  start: {T: 0}\n  integrator: {dt: 0.1}\nrecording: {twin: a, every: 0.1}\n"
    )
    config = load_config([f"conf={path}"], entry="test")
    return System(config.system, config.where)


def test_heat_and_what_it_loses(tmp_path: Path) -> None:
    """Of the bundled bar: the hidden loss, within its own error, and the whole field."""
    assert (
        record_command.main(["conf=heat", "recording.twin=a", "seed=3", f"output={tmp_path}"]) == 0
    )
    found = closed_form(*problem_and_prior("heat", tmp_path / "recording.nc"))
    assert found is not None and found.terms is not None
    [term] = found.terms
    assert (term["equation"], term["term"]) == ("T", "T")
    assert term["coefficient"] == pytest.approx(-0.04, abs=3 * 5e-5)
    with xr.open_dataset(tmp_path / "sealed.nc", engine="h5netcdf") as sealed:
        truth = sealed["T"].values[: len(found.states)]
    error = found.states[:, 0, : truth.shape[1]].numpy() - truth
    assert np.sqrt(np.mean(error**2)) < 0.003 * truth.std()


def test_a_system_that_is_not_linear_has_none(quick: Path, tmp_path: Path) -> None:
    assert record_command.main([f"conf={quick}", f"output={tmp_path}"]) == 0
    assert closed_form(*problem_and_prior(str(quick), tmp_path / "recording.nc")) is None
