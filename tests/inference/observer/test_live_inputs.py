"""Inputs that come in while they drive a simulator."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from dashred.data.inputs import with_inputs
from dashred.inference.observer.live_inputs import KNOTS, LiveInputs
from dashred.inference.observer.march import March
from dashred.physics.backends.input_signals import InputSignals
from dashred.physics.solvers.simulate import simulate
from tests.support import driven

FIELD = """
system:
  title: a heated rod
  fields: {u: temperature}
  axes: {x: {length: 1.0, points: 16}}
  equations: {u: "0.01*d(u, x, 2) - 0.5*u + cos(2*pi*x)*V"}
  inputs: {V: voltage}
  start: {u: "0"}
  integrator: {dt: 0.02}
"""


def texts() -> dict[str, str]:
    plain = driven.TEXT
    inputs = "inputs: {V: voltage}"
    return {
        "linear": plain,
        "held": plain.replace(inputs, "inputs: {V: {column: voltage, hold: true}}"),
        "delayed": plain.replace(inputs, "inputs: {V: {column: voltage, delay: 0.3}}"),
        "field": FIELD,
    }


def signals(count: int) -> InputSignals:
    times = 0.1 * np.arange(count, dtype=np.float64)
    return InputSignals(times, {"voltage": driven.voltage(times)})


@pytest.mark.parametrize("kind", texts())
def test_steps_are_those_of_the_whole_recording(kind: str) -> None:
    system, whole = driven.system(texts()[kind]), signals(60)
    first = InputSignals(whole.times[:2], {"voltage": whole.values["voltage"][:2]})
    inputs = LiveInputs(system, first)
    march = March(inputs.system, inputs)
    start = np.linspace(0.5, 1.0, int(np.prod((len(system.fields), *system.grid.shape))))[None]
    state, path = start, []
    for i in range(1, 60):
        inputs.add(float(whole.times[i]), {"voltage": float(whole.values["voltage"][i])})
        state = march(state, float(whole.times[i - 1]), 0.1, known=float(whole.times[i]))
        path.append(state[0])
    exact = simulate(
        with_inputs(system, whole), march.on_grid(start), torch.from_numpy(whole.times)
    )
    np.testing.assert_allclose(np.array(path), march.off_grid(exact[0, 1:]), rtol=1e-9, atol=1e-9)


def test_what_comes_later_does_not_act() -> None:
    system, whole = driven.system(), signals(60)
    inputs = LiveInputs(system, whole)
    march, start = March(inputs.system, inputs), np.array([[1.0, 0.0]])
    held = march(start, 2.0, 1.0, known=2.0)
    constant = {"voltage": np.full(60, whole.values["voltage"][20])}
    exact = with_inputs(system, InputSignals(whole.times, constant))
    times = torch.tensor([2.0, 3.0], dtype=torch.float64)
    expected = simulate(exact, torch.from_numpy(start), times)[0, 1].numpy()
    np.testing.assert_allclose(held[0], expected, rtol=1e-12)
    assert np.abs(march(start, 2.0, 1.0) - held).max() > 0.05


def test_a_delayed_input_is_known_ahead() -> None:
    system, whole = driven.system(texts()["delayed"]), signals(60)
    inputs = LiveInputs(system, whole)
    march, start = March(inputs.system, inputs), np.array([[1.0, 0.0]])
    times = torch.tensor([2.0, 2.3], dtype=torch.float64)
    exact = simulate(with_inputs(system, whole), torch.from_numpy(start), times)[0, 1].numpy()
    np.testing.assert_allclose(march(start, 2.0, 0.3, known=2.0)[0], exact, rtol=1e-9)


def test_another_record_begins() -> None:
    inputs = LiveInputs(driven.system(), signals(60))
    inputs.forget_from(3.05)
    inputs.add(3.05, {"voltage": 7.0})
    inputs.add(3.15, {})
    assert inputs.at(3.0) == pytest.approx(driven.voltage(np.array([3.0])))
    assert inputs.at(3.05) == inputs.at(9.0) == pytest.approx(7.0)
    inputs.forget_from(-5.0)
    inputs.add(-5.0, {"voltage": 2.0})
    assert inputs.first < -5.0 and inputs.at(-5.0) == pytest.approx(2.0)


def test_only_the_last_samples_are_kept(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("dashred.inference.observer.live_inputs.REMEMBERED", 10)
    inputs = LiveInputs(driven.system(), signals(5))
    for i in range(5, 5000):
        inputs.add(0.1 * i, {"voltage": float(i)})
    assert inputs.first > 490 and inputs.at(499.85) == pytest.approx(4998.5)
    # More samples in a step than there are knots: the last ones are read.
    inputs.show(0.0, 499.9)
    found = inputs.system.input_signals.at(499.85)["V"]
    assert found == pytest.approx(4998.5) and len(inputs.system.input_signals.times) == KNOTS
