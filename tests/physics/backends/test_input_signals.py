"""Inputs drive a system alike however it is run, and as the theory has it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import torch

from dashred.physics.backends.input_signals import Array, InputSignals
from dashred.physics.solvers.compiled.runge_kutta import CompiledRungeKutta
from dashred.physics.solvers.compiled_simulator import compile_system
from dashred.physics.solvers.simulate import simulate
from dashred.physics.system import System
from dashred.physics.tangents.tangent_linear import tangent_linear
from tests import laws

CIRCUIT = """
system:
  title: a capacitor charged through a resistor
  fields: {v: voltage}
  parameters: {tau: 0.5}
  inputs: {e: source}
  equations: {v: (e - v)/tau}
  start: {v: 0}
  integrator: {method: rk4, dt: 0.005}
recording: {twin: a, sensors: 1, noise: 0, duration: 1, every: 0.1}
"""
RING = """
system:
  title: heat on a ring that is warmed in one place
  axes: {x: {length: 6, points: 32}}
  fields: {u: temperature}
  inputs: {e: power}
  equations: {u: "0.2*d(u, x, 2) - 0.1*u**3 + e*(1 + cos(pi*x/3))"}
  start: {u: 0}
  integrator: {dt: 0.02}
recording: {twin: a, sensors: 4, noise: 0, duration: 1, every: 0.1}
"""
TIMES = torch.arange(21, dtype=torch.float64) * 0.1


def driven(folder: Path, text: str, values: Array, every: float = 0.1) -> System:
    system = laws.declared(folder, text)
    times = np.arange(len(values), dtype=np.float64) * every
    return System(system.config, system.where, InputSignals(times, {"e": values}))


def test_between_samples_lies_a_straight_line_and_beyond_them_nothing_changes() -> None:
    measured = InputSignals(np.array([1.0, 2.0]), {"e": np.array([3.0, 5.0])})
    assert measured.at(1.5)["e"] == 4.0
    np.testing.assert_array_equal(measured.at(np.array([0.0, 9.0]))["e"], [3.0, 5.0])


def test_a_ramp_charges_a_capacitor_as_it_should(tmp_path: Path) -> None:
    system = driven(tmp_path, CIRCUIT, np.linspace(0.0, 2.0, 21))
    [path] = simulate(system, torch.zeros((1, 1), dtype=torch.float64), TIMES)
    exact = TIMES - 0.5 * (1 - torch.exp(-TIMES / 0.5))
    torch.testing.assert_close(path[:, 0], exact, rtol=0, atol=1e-9)


@pytest.mark.parametrize("text", [CIRCUIT, RING])
def test_compiled_runs_are_driven_alike(tmp_path: Path, text: str) -> None:
    system = driven(tmp_path, text, np.sin(np.arange(21) * 0.7))
    start = torch.zeros((2, 1, *system.grid.shape), dtype=torch.float64)
    weights = torch.zeros((2, 0), dtype=torch.float64)
    fast = compile_system(system, ())(start, TIMES, weights)
    torch.testing.assert_close(fast, simulate(system, start, TIMES), rtol=0, atol=1e-9)
    assert float(fast.abs().max()) > 0.05


def test_a_term_may_read_an_input(tmp_path: Path) -> None:
    system = driven(tmp_path, CIRCUIT, np.sin(np.arange(21) * 0.7))
    term = laws.term(system, "v", "e*v").terms[0]
    start = torch.full((2, 1), 0.3, dtype=torch.float64)
    weights = torch.tensor([[0.0], [0.4]], dtype=torch.float64)
    found = CompiledRungeKutta(system, (term,))(start, TIMES, weights)
    changed = system.with_terms([(term, 0.4)])
    torch.testing.assert_close(found[1:], simulate(changed, start[1:], TIMES), rtol=0, atol=1e-9)
    torch.testing.assert_close(found[:1], simulate(system, start[:1], TIMES), rtol=0, atol=1e-9)


def test_the_tangent_of_a_driven_term_is_its_difference(tmp_path: Path) -> None:
    system = driven(tmp_path, RING, np.sin(np.arange(21) * 0.7))
    term = laws.term(system, "u", "e*u").terms[0]
    start = 0.5 + torch.zeros((1, 1, 32), dtype=torch.float64)
    nowhere = torch.zeros((0, 1, 32), dtype=torch.float64)
    steps = list(tangent_linear(system, start[0], nowhere, TIMES, None, [(term,)]))
    tangent = torch.stack([tangents[0] for _, tangents in steps])
    h = 1e-5
    ahead, behind = (simulate(system.with_terms([(term, s * h)]), start, TIMES)[0] for s in (1, -1))
    torch.testing.assert_close(tangent, (ahead - behind) / (2 * h), rtol=1e-6, atol=1e-8)


def test_two_recordings_of_one_system_do_not_share_their_inputs(tmp_path: Path) -> None:
    ends = []
    for size in (1.0, 2.0):
        system = driven(tmp_path, CIRCUIT, np.full(21, size))
        start = torch.zeros((1, 1), dtype=torch.float64)
        run = CompiledRungeKutta(system, ())
        ends.append(float(run(start, TIMES, torch.zeros((1, 0), dtype=torch.float64))[0, -1, 0]))
    assert ends[1] == pytest.approx(2 * ends[0])
