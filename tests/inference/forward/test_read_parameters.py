"""Sensors that depend on uncertain parameters: readings and derivatives of both engines."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch

from dashred.data.observation_operator import ObservationOperator
from dashred.data.sensors import Sensor
from dashred.inference.forward.candidate_simulator import CandidateSimulator
from dashred.inference.forward.candidates import ChangePrior, build_candidates
from dashred.inference.forward.episodes import EpisodeStarts, stack_times
from dashred.inference.forward.forward_model import ForwardModel
from dashred.inference.forward.law_block import LawBlock
from dashred.inference.forward.parameter_block import split_parameters
from dashred.inference.forward.read_parameters import read_parameters
from dashred.inference.forward.sensor_block import SensorBlock
from dashred.inference.forward.simulator import Simulator
from dashred.inference.results.corrected_system import with_parameters
from dashred.inference.segments.state_sensors import StateSensors
from dashred.physics.backends.input_signals import InputSignals
from dashred.physics.runs.initial_state_prior import StartPrior, field_rms, nominal_start
from dashred.physics.solvers.simulate import simulate
from dashred.physics.system import System
from tests import laws

CELL = """
system:
  title: a cell
  fields: {v: polarisation, q: charge}
  parameters: {R0: 0.3, tau: 2.0, g: 1.1}
  inputs: {I: amp}
  let:
    U: g*(4 - v**2 - 0.2*q)
    U_known: -g*R0*I
  equations: {v: (I - v)/tau, q: I - 0.1*v}
  start: {v: 0.5, q: 1}
  spread: {v: 0.1, q: 0.1}
  integrator: {method: rk4, dt: 0.05}
recording: {path: a.csv}
"""
TIMES = 0.2 * torch.arange(16, dtype=torch.float64)
SIGNALS = [np.sin(TIMES.numpy()), np.cos(2 * TIMES.numpy())]
SENSORS = (Sensor("U", "U", known="U_known"), Sensor("q", "q"))
CHANGES = {"R0": 0.05, "tau": 0.1, "g": -0.2}
PRIORS = {name: ChangePrior(0.0, 0.3) for name in CHANGES}


@pytest.fixture
def systems(tmp_path: Path) -> list[System]:
    """Two episodes with inputs of their own."""
    bare = laws.declared(tmp_path, CELL)
    signals = [InputSignals(TIMES.numpy(), {"I": values}) for values in SIGNALS]
    return [System(bare.config, bare.where, each) for each in signals]


@pytest.fixture
def model(systems: list[System]) -> ForwardModel:
    first = systems[0]
    start = nominal_start(first)[0]
    states = simulate(first, start[None], TIMES)[0]
    found = build_candidates(first, [], states, TIMES, priors=PRIORS)
    parameters, _ = split_parameters(found)
    parts = [CandidateSimulator(each, each.dt, parameters.candidates) for each in systems]
    priors = tuple(StartPrior(first, start, field_rms(states), 2) for _ in systems)
    read = read_parameters(SENSORS, systems)
    sensors = SensorBlock(ObservationOperator(SENSORS, first), 2, parameters=read)
    return ForwardModel(
        Simulator(parts, parameters),
        EpisodeStarts(priors),
        LawBlock([]),
        sensors,
        stack_times([TIMES, TIMES]),
    )


def unknowns(model: ForwardModel, share: float) -> torch.Tensor:
    z = torch.zeros(model.modes, dtype=torch.float64)
    names = [c.name for c in model.simulator.parameters.candidates]
    changes = torch.tensor([share * CHANGES[name] for name in names], dtype=torch.float64)
    z[model.start.size :] = model.scaled_changes(changes)
    return z


def test_a_reading_is_affine_in_a_gain_and_exact_in_it(
    model: ForwardModel, systems: list[System]
) -> None:
    """Of both parameters together, only the product of the changes is left out."""
    assert model.sensors.parameters is not None
    assert set(model.sensors.parameters.slopes) == {"R0", "g"}
    none = torch.zeros((1, 0), dtype=torch.float64)
    names = [c.name for c in model.simulator.parameters.candidates]
    z = unknowns(model, 0.0)
    z[model.start.size + names.index("g")] = CHANGES["g"] / 0.3
    found = model.readings(z[None], none)[0].reshape(len(TIMES), 2, 2)
    for episode, system in enumerate(systems):
        path = model.states(z[None], none)[0, :, episode]
        changed = with_parameters(system, {"g": 1.1 + CHANGES["g"]})
        clock = TIMES.numpy()
        known = changed.evaluate("U_known", path, clock) - system.evaluate("U_known", path, clock)
        torch.testing.assert_close(found[:, episode, 0], changed.evaluate("U", path) + known)
        torch.testing.assert_close(found[:, episode, 1], path[:, 1])


def test_the_derivatives_by_parameters_that_sensors_read(model: ForwardModel) -> None:
    z, none = unknowns(model, 0.5), torch.zeros(0, dtype=torch.float64)
    found = model.linearise(z, none).by_start.double()
    for j in range(model.modes):
        step = torch.zeros_like(z)
        step[j] = 1e-4
        ahead, behind = model.readings(torch.stack([z + step, z - step]), none.expand(2, 0))
        difference = (ahead - behind) / 2e-4
        size = float(difference.abs().max())
        torch.testing.assert_close(found[..., j], difference, rtol=0.01, atol=0.01 * size)


def test_segments_read_the_same(model: ForwardModel, systems: list[System]) -> None:
    sensors, candidates = StateSensors(SENSORS, systems[0]), model.simulator.parameters.candidates
    assert sensors.parameters == {"R0", "g"} and sensors.fields.tolist() == [-1, 1]
    values = np.array([CHANGES[c.name] for c in candidates])
    z, none = unknowns(model, 1.0), torch.zeros((1, 0), dtype=torch.float64)
    path = model.states(z[None], none)[0, :, 1].numpy()
    clock = {"t": TIMES.numpy(), "I": SIGNALS[1]}
    changes = sensors.changes(candidates, values, clock)
    read = sensors.read(path, changes)
    expected = model.readings(z[None], none)[0, :, 2:].numpy()
    np.testing.assert_allclose(read, expected, rtol=1e-6)
    for field in range(2):
        step = 1e-5 * np.eye(2)[field]
        slope = (sensors.read(path + step, changes) - sensors.read(path - step, changes)) / 2e-5
        np.testing.assert_allclose(sensors.slopes(path, changes)[..., field], slope, atol=1e-7)
    for place, name in enumerate(changes.names):
        moved = replace(changes, values=changes.values + 1e-3 * np.eye(len(changes.names))[place])
        slope = (sensors.read(path, moved) - read) / 1e-3
        by_parameter = sensors.by_parameter(path, changes)[..., place]
        np.testing.assert_allclose(by_parameter, slope, atol=1e-7, err_msg=name)


def test_a_field_is_read_through_a_gain_and_an_offset(tmp_path: Path) -> None:
    text = CELL.replace("U: g*(4 - v**2 - 0.2*q)", "U: g*v - 3")
    sensors = StateSensors(SENSORS, laws.declared(tmp_path, text))
    assert sensors.fields.tolist() == [0, 1]
    values = sensors.fields_of(np.array([[1.1 * 0.7 - 3, 5.0]]))
    np.testing.assert_allclose(values, [[0.7, 5.0]])
