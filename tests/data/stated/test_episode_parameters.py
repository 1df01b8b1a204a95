"""Parameters with a value per episode, and inputs with a fitted delay, as uncertain parameters."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch

from dashred.core.errors import InputError
from dashred.data.episodes import Episode, Episodes
from dashred.data.inputs import with_inputs
from dashred.data.recording import Recording
from dashred.data.sensors import Sensor
from dashred.data.stated.episode_parameters import with_episode_parameters
from dashred.data.stated.fitted_delays import about_delays, with_fitted_delays
from dashred.inference.results.corrected_system import with_parameters
from dashred.physics.backends.input_signals import NO_INPUTS, InputSignals
from dashred.physics.parameter_sensitivity import parameter_tendency
from dashred.physics.system import System
from tests import laws

TEXT = """
system:
  title: a tank
  fields: {h: level}
  parameters: {k: {value: 0.5, spread: 0.1, per: episode}, a: 2.0}
  inputs: {e: {column: pump, hold: HOLD, delay: 0.4, delay_spread: 0.2}}
  let: {flow: k*h}
  equations: {h: e - a*flow}
  start: {h: 1 + k}
  energy: k*h**2
  units: {k: 1/s}
  integrator: {dt: 0.1}
recording: {path: a.csv}
"""
TIMES = np.linspace(0.0, 4.0, 41)


def tank(folder: Path, hold: bool = False) -> System:
    return laws.declared(folder, TEXT.replace("HOLD", str(hold).lower()))


def recorded(*names: str, pump: np.ndarray | None = None) -> Episodes:
    inputs = NO_INPUTS if pump is None else InputSignals(TIMES, {"pump": pump})
    recording = Recording((Sensor("h", "h"),), TIMES, np.ones((41, 1)), inputs)
    return Episodes(tuple(Episode(name, recording) for name in names))


def test_every_episode_has_a_parameter(tmp_path: Path) -> None:
    pump = np.sin(TIMES)
    found = with_episode_parameters(tank(tmp_path), recorded("day 1", "day 2", pump=pump))
    config = found.system.config
    assert found.parameters == {"k_in_day_1": "day 1", "k_in_day_2": "day 2"}
    assert config.parameter_spread == {"k_in_day_1": 0.1, "k_in_day_2": 0.1}
    assert "k" not in config.parameters and config.units["k_in_day_2"] == "1/s"
    assert config.start == {"h": "1.5"} and "k" not in str(config.energy)
    assert found.system.measured_inputs == ("e",)
    changed = {"k_in_day_1": 1.0, "k_in_day_2": 3.0}
    state = torch.tensor([[2.0]], dtype=torch.float64)
    for part, k in zip(found.episodes.episodes, changed.values(), strict=True):
        system = with_parameters(with_inputs(found.system, part.recording.inputs), changed)
        assert float(system.evaluate("flow", state, 1.3)) == pytest.approx(2 * k)
        np.testing.assert_array_equal(part.recording.inputs.values["pump"], pump)


def test_a_single_episode_needs_no_further_parameter(tmp_path: Path) -> None:
    system, episodes = tank(tmp_path), recorded("")
    found = with_episode_parameters(system, episodes)
    assert found.system is system and found.episodes is episodes


@pytest.mark.parametrize("hold", [False, True])
def test_an_input_moves_with_its_delay(tmp_path: Path, hold: bool) -> None:
    """To first order: over a long time, a shift moves the integral by the change of the input."""
    pump = np.where(TIMES < 1.95, 1.0, 3.0) if hold else np.sin(2 * TIMES)
    found = with_fitted_delays(tank(tmp_path, hold), recorded("", pump=pump))
    assert found.parameters == {"delay_of_e": "e"}
    config, inputs = found.system.config, found.episodes.episodes[0].recording.inputs
    assert (config.parameters["delay_of_e"], config.parameter_spread["delay_of_e"]) == (0.4, 0.2)
    assert found.system.measured_inputs == ("e_now",)
    assert set(parameter_tendency(found.system, "delay_of_e")) == {"h"}
    stated = about_delays(found.system, found.parameters, inputs)
    moved = with_parameters(stated, {"delay_of_e": 0.45})
    exact = about_delays(moved, found.parameters, inputs)
    clock = np.linspace(0.6, 3.6, 3001)
    state = torch.zeros((len(clock), 1), dtype=torch.float64)
    by_system = [
        each.evaluate("e", state, clock).numpy().mean() * 3.0 for each in (stated, moved, exact)
    ]
    difference = by_system[2] - by_system[0]
    assert abs(difference) > 0.01
    assert by_system[1] - by_system[0] == pytest.approx(difference, rel=0.05)
    negative = with_parameters(stated, {"delay_of_e": -0.1})
    assert about_delays(negative, found.parameters, inputs).config.inputs["e_now"].delay == 0


def test_delays_that_cannot_be_fitted(tmp_path: Path) -> None:
    system, episodes = tank(tmp_path), recorded("", pump=TIMES)
    taken = system.with_config(replace(system.config, parameters={"e_now": 1.0, "a": 2, "k": 1}))
    with pytest.raises(InputError, match="needs the name e_now, which is taken"):
        with_fitted_delays(taken, episodes)
    late = replace(system.config.inputs["e"], delay=9.0)
    with pytest.raises(
        InputError, match="the delay of the input e is 9, but its samples span only 4"
    ):
        with_fitted_delays(system.with_config(replace(system.config, inputs={"e": late})), episodes)
    text = TEXT.replace("title: a tank", "title: a tank\n  axes: {x: {length: 1, points: 8}}")
    with pytest.raises(InputError, match="cannot be fitted in a system with axes"):
        with_fitted_delays(laws.declared(tmp_path, text.replace("HOLD", "true")), episodes)
