"""Steps of bundled systems as a program takes them, against their equations."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from dashred.config import bundled_names, load_config
from dashred.evaluation.programs import bundled_steps
from dashred.physics.runs.initial_state_prior import nominal_start
from dashred.physics.solvers.simulate import simulate
from dashred.physics.system import System


@pytest.fixture(autouse=True)
def counted_anew(tmp_path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    bundled_steps._tally.cache_clear()


def test_every_bundled_system_has_a_step() -> None:
    assert all(callable(getattr(bundled_steps, name)) for name in bundled_names())


@pytest.mark.parametrize("name", ["pendulum", "heat"])
def test_a_step_is_that_of_the_equations(name: str) -> None:
    config = load_config([f"conf={name}", "recording.twin=null"], entry="train")
    system = System(config.system, config.where)
    start = nominal_start(system)
    states = torch.cat([start, 1.1 * start])
    own = system.grid.own(states).numpy()
    ones = (1,) * len(system.axes)
    dt = np.full((2, *ones), 2 * system.dt)
    named = {field: own[:, i] for i, field in enumerate(system.fields)}
    found = getattr(bundled_steps, name)(named, 0 * dt, dt, {}, {})
    expected = simulate(system, states, torch.tensor([0.0, 2 * system.dt]).double())[:, -1]
    for i, field in enumerate(system.fields):
        np.testing.assert_allclose(found[field], system.grid.own(expected).numpy()[:, i], atol=1e-9)


def test_inputs_and_time_steps_differ_from_state_to_state() -> None:
    charge, flux = np.array([0.8, 0.8, 0.2]), np.array([0.0, 0.0, 0.1])
    dt, voltage = np.array([0.02, 0.02, 0.04]), np.array([0.0, 1.0, 0.5])

    rlc = vars(bundled_steps)["rlc"]

    def step(rows: list[int]) -> np.ndarray:
        state = {"Q": charge[rows], "phi": flux[rows]}
        inputs = {"V": voltage[rows]}
        return np.stack([*rlc(state, 0 * dt[rows], dt[rows], inputs, {}).values()])

    together = step([0, 1, 2])
    np.testing.assert_allclose(together, np.concatenate([step([i]) for i in range(3)], axis=1))
    assert together[1, 1] - together[1, 0] == pytest.approx(0.02, rel=1e-2)
    assert np.fromfile(bundled_steps.TALLY)[:2].tolist() == [4, 6]
