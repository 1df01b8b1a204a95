"""Sensors that read a product of inputs and a function of the state: divided by the inputs."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from dashred.config import load_config
from dashred.core.errors import InputError
from dashred.core.stated.noise import parse_noise
from dashred.data.episodes import Episode, Episodes, with_sensors
from dashred.data.inputs import with_inputs
from dashred.data.noise_level import noise_std
from dashred.data.recording import Recording
from dashred.data.sensors import Sensor
from dashred.data.stated.known_factor import noise_factors, with_even_noise
from dashred.data.stated.known_readings import (
    known_readings,
    subtract_known_readings,
    with_known_at,
)
from dashred.data.stated.relative_noise import relative_noise
from dashred.physics.backends.input_signals import InputSignals
from dashred.physics.system import System

TEXT = """
system:
  title: a cell
  fields: {v: polarisation}
  parameters: {ocv: 3.8, R: 0.03, k: 2}
  inputs: {I: amp}
  let: {P: LET}
  equations: {v: I - v}
  start: {v: 0}
  spread: {v: 0.1}
  units: {P: W, I: A}
  integrator: {method: rk4, dt: 0.1}
recording: {path: cell.csv}
"""
TIMES = np.arange(400.0)
# 0 at the first samples.
AMP = 3 * np.where(TIMES < 20, 0, np.sin(TIMES / 20) ** 3)
STATE = 1 + 0.2 * np.cos(TIMES / 30)
STD = 0.02

MakeCell = Callable[[str], System]


@pytest.fixture
def cell(tmp_path: Path) -> MakeCell:
    def make(let: str) -> System:
        (tmp_path / "cell.yaml").write_text(TEXT.replace("LET", let))
        config = load_config([f"conf={tmp_path}/cell.yaml"], entry="test")
        return System(config.system, config.where)

    return make


def recorded(power: np.ndarray, std: float | None = STD) -> Episodes:
    signals = InputSignals(TIMES, {"amp": AMP})
    recording = Recording((Sensor("P", "P", (), std),), TIMES, power[:, None], signals)
    return Episodes((Episode("", recording),))


@pytest.mark.parametrize(
    ("let", "power", "of_state"),
    [
        ("I*v", AMP * STATE, STATE),
        ("ocv - k*I*v", 3.8 - 2 * AMP * STATE, -2 * STATE),
        ("I*(ocv - R*I - v**2)", AMP * (3.8 - 0.03 * AMP - STATE**2), -(STATE**2)),
        ("I**2*v/(1 + t)", AMP**2 * STATE / (1 + TIMES), STATE),
    ],
)
def test_the_factor_is_divided_by(
    cell: MakeCell, let: str, power: np.ndarray, of_state: np.ndarray
) -> None:
    system, found, clauses = subtract_known_readings(cell(let), recorded(power))
    read = found.single("r").values[:, 0]
    seen = np.isfinite(read)
    assert 0.7 < seen.mean() < 1
    np.testing.assert_allclose(read[seen], of_state[seen], atol=1e-9)
    assert "divided by" in clauses[0] and "P_of_state" not in system.units


def test_the_noise_is_larger_where_the_factor_is_small(cell: MakeCell) -> None:
    noise = STD * np.random.default_rng(5).standard_normal(len(TIMES))
    for std in (STD, None):
        episodes = recorded(AMP * STATE + noise, std)
        system, found, _ = subtract_known_readings(cell("I*v"), episodes)
        recording = found.single("r")
        driven = with_inputs(system, recording.inputs)
        sizes = relative_noise(recording, 0.0, noise_factors(recording, driven))
        assert sizes is not None
        sigma = float(noise_std(with_even_noise(recording, driven))[0])
        seen = np.isfinite(recording.values[:, 0])
        errors = (recording.values[:, 0] - STATE)[seen]
        expected = STD / np.abs(AMP[seen])
        np.testing.assert_allclose(sigma * sizes[seen, 0], expected, rtol=1e-9 if std else 0.15)
        assert np.std(errors / (sigma * sizes[seen, 0])) == pytest.approx(1, abs=0.15)


def test_an_uncertain_parameter_of_the_known_part_is_followed(cell: MakeCell) -> None:
    power = 3.8 - 2 * AMP * STATE
    system, found, _ = subtract_known_readings(cell("ocv - k*I*v"), recorded(power))
    recording = found.single("r")
    assert recording.sensors[0].quantities == ("P_of_state", "P_known")
    driven = with_inputs(system, recording.inputs)
    seen = np.isfinite(recording.values[:, 0])
    known = known_readings(recording, driven)[:, 0]
    np.testing.assert_allclose(known[seen], 3.8 / AMP[seen])
    parameters = {**system.config.parameters, "ocv": 3.9}
    other = driven.with_config(replace(system.config, parameters=parameters))
    moved = with_known_at(recording, driven, other)
    np.testing.assert_allclose(moved.values[seen, 0], -2 * STATE[seen] - 0.1 / AMP[seen])


def test_what_cannot_be_divided_is_refused(cell: MakeCell) -> None:
    still = recorded(AMP)
    part = replace(still.single("r"), inputs=InputSignals(TIMES, {"amp": 0 * AMP}))
    with pytest.raises(InputError, match="a product with I, which is 0 at all samples"):
        subtract_known_readings(cell("I*v"), Episodes((Episode("", part),)))
    law = parse_noise("5% of reading", "recording.std", "r").law
    noisy = with_sensors(still, (replace(still.sensors[0], noise_law=law),))
    with pytest.raises(InputError, match="only a constant noise is supported") as told:
        subtract_known_readings(cell("I*v"), noisy)
    assert "cell.yaml" in str(told.value)
