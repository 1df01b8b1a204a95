"""Sensors that read functions of inputs and time: the known part is subtracted."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from dashred.config import load_config
from dashred.core.errors import InputError
from dashred.data.episodes import Episode, Episodes
from dashred.data.inputs import with_inputs
from dashred.data.recording import Recording
from dashred.data.sensors import Sensor
from dashred.data.stated.known_readings import (
    check_reads_state,
    check_uncertain_have_effect,
    known_readings,
    subtract_known_readings,
    with_known_at,
)
from dashred.physics.backends.input_signals import InputSignals
from dashred.physics.system import System

TEXT = """
system:
  title: a cell
  fields: {v: polarisation, q: charge}
  parameters: {ocv: 3.8, R: 0.03, tau: 2, k: 0.01}
  inputs: {I: {column: amp, hold: true}}
  let:
    drop: R*I + v
    U: LET
  equations: {v: (I - v)/tau, q: I}
  start: {v: 0, q: 0}
  spread: {v: 0.1}
  units: {U: V, I: A}
  integrator: {method: rk4, dt: 0.1}
recording: {path: cell.csv}
"""
TIMES = np.arange(6.0)
AMP = np.array([0.0, 2.0, 2.0, 0.0, 1.0, 1.0])
VOLT = np.array([3.8, 3.7, np.nan, 3.6, 3.5, 3.4])

MakeCell = Callable[[str], System]


@pytest.fixture
def cell(tmp_path: Path) -> MakeCell:
    def make(let: str) -> System:
        (tmp_path / "cell.yaml").write_text(TEXT.replace("LET", let))
        config = load_config([f"conf={tmp_path}/cell.yaml"], entry="test")
        return System(config.system, config.where)

    return make


def recorded() -> Episodes:
    signals = InputSignals(TIMES, {"amp": AMP})
    sensors = (Sensor("volt", "U", (), 0.01), Sensor("q", "q"))
    values = np.column_stack([VOLT, np.cumsum(AMP)])
    return Episodes((Episode("", Recording(sensors, TIMES, values, signals)),))


@pytest.mark.parametrize(
    ("let", "known"),
    [
        ("ocv - drop - k*q", -0.03 * AMP),
        ("ocv - 2*(v + sin(t)) - k*q", -2 * np.sin(TIMES)),
        ("v - I*t/10", -AMP * TIMES / 10),
    ],
)
def test_what_is_known_is_subtracted(cell: MakeCell, let: str, known: np.ndarray) -> None:
    system, found, clauses = subtract_known_readings(cell(let), recorded())
    [part] = found.episodes
    np.testing.assert_allclose(part.recording.values[:, 0], VOLT - known, atol=1e-12)
    np.testing.assert_array_equal(part.recording.values[:, 1], np.cumsum(AMP))
    volt, charge = part.recording.sensors
    assert (volt.name, volt.reads, volt.std) == ("volt", "U_of_state", 0.01)
    assert charge.reads == "q" and len(clauses) == 1 and clauses[0].startswith("U without")
    assert system.units["U_of_state"] == "V"
    check_reads_state(system, found.sensors)


def test_the_rest_follows_a_change_of_a_parameter(cell: MakeCell) -> None:
    system, _, _ = subtract_known_readings(cell("ocv - drop - k*q"), recorded())
    assert "k" in system.config.let["U_of_state"]
    doubled = replace(system.config, parameters={**system.config.parameters, "k": 0.02})
    state = np.array([[0.5, 3.0]])
    import torch

    read = [
        float(each.evaluate("U_of_state", torch.from_numpy(state))[0])
        for each in (system, system.with_config(doubled))
    ]
    assert read == pytest.approx([3.8 - 0.5 - 0.03, 3.8 - 0.5 - 0.06])


def test_sensors_of_the_state_are_left_as_they_are(cell: MakeCell) -> None:
    system, episodes = cell("ocv - v - k*q"), recorded()
    assert subtract_known_readings(system, episodes) == (system, episodes, [])


@pytest.mark.parametrize(
    ("let", "says"),
    [
        ("q - I*v", "depends on 'I'"),
        ("sin(I*v)", "depends on 'I'"),
        ("v/(1 + I*q)", "depends on 'I'"),
        ("exp(v - t)", "depends on 't'"),
        ("ocv - R*I", "does not depend on a field"),
    ],
)
def test_other_functions_are_refused(cell: MakeCell, let: str, says: str) -> None:
    with pytest.raises(InputError, match=says) as refused:
        subtract_known_readings(cell(let), recorded())
    assert "cell.yaml:9" in str(refused.value)


def test_a_twin_reads_the_state_alone(cell: MakeCell) -> None:
    with pytest.raises(InputError, match="depends on 'I'"):
        check_reads_state(cell("ocv - drop"), [Sensor("volt", "U")])


def test_what_depends_on_an_uncertain_parameter_is_kept_as_a_let(cell: MakeCell) -> None:
    system = cell("ocv - drop - k*q")
    spread = replace(system.config, parameter_spread={"R": 0.01})
    system, found, _ = subtract_known_readings(system.with_config(spread), recorded())
    [part] = found.episodes
    volt, charge = part.recording.sensors
    assert volt.quantities == ("U_of_state", "U_known") and charge.quantities == ("q",)
    driven = with_inputs(system, part.recording.inputs)
    np.testing.assert_allclose(known_readings(part.recording, driven)[:, 0], -0.03 * AMP)
    parameters = {**system.config.parameters, "R": 0.05}
    other = driven.with_config(replace(system.config, parameters=parameters))
    moved = with_known_at(part.recording, driven, other)
    np.testing.assert_allclose(moved.values[:, 0], VOLT + 0.05 * AMP, atol=1e-12)


def test_an_uncertain_parameter_needs_an_effect(cell: MakeCell) -> None:
    system = cell("ocv - drop - k*q")
    uncertain = system.with_config(replace(system.config, parameter_spread={"k": 0.01}))
    sensors = recorded().sensors
    check_uncertain_have_effect(uncertain, sensors)
    with pytest.raises(InputError, match="k has a spread, but neither"):
        check_uncertain_have_effect(uncertain, sensors[1:])
