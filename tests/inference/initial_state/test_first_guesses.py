"""First guesses: each is a usable start, and those from data find an unknown phase."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from torch import Tensor

from dashred.core.budget import Deadline, OutOfTimeError
from dashred.data.observation_operator import ObservationOperator
from dashred.data.sensors import Sensor
from dashred.inference.initial_state.ensemble_filter import FilterSettings, ensemble_filter
from dashred.inference.initial_state.first_guesses import (
    FirstGuessSettings,
    NetworkEstimate,
    Readings,
    first_guesses,
)
from dashred.inference.initial_state.start_models import LinearStart, StartModel
from dashred.physics.runs.ensemble import Ensemble
from dashred.physics.runs.initial_state_prior import StartPrior, field_rms, nominal_start
from dashred.physics.solvers.simulate import simulate
from dashred.physics.system import System, Term
from tests.ring import SENSORS, TIMES, ensemble, linear_system

SETTINGS = FirstGuessSettings(analogs=40, filtered=8, modes=20)


def test_first_guesses_find_a_shifted_start_on_a_ring(tmp_path: Path) -> None:
    system = linear_system(tmp_path)
    members = ensemble(system, 40)
    truth = torch.roll(ensemble(system, 1, seed=7).states[0], 13, dims=-1)
    readings = record(system, truth, SENSORS, 0.02)
    network = NetworkEstimate(truth[0] + 0.1, torch.tensor([0.1], dtype=torch.float64))
    guesses = first_guesses(system, prior(system), members, (), readings, network, SETTINGS)
    assert list(guesses) == ["prior", "blue", "filter", "dashred"]
    wrong = rms(guesses["prior"], truth[0])
    for name in ("blue", "filter"):
        assert rms(guesses[name], truth[0]) < min(0.05, 0.1 * wrong)
        assert unreached(guesses[name], truth[0]) < 0.02


def test_the_network_guess_has_its_state_and_its_error(tmp_path: Path) -> None:
    system = linear_system(tmp_path)
    truth = ensemble(system, 1, seed=7).states[0]
    network = NetworkEstimate(truth[0], torch.tensor([0.3], dtype=torch.float64))
    readings = record(system, truth, SENSORS, 0.02)
    found = first_guesses(
        system, prior(system), ensemble(system, 40), (), readings, network, SETTINGS
    )["dashred"]
    assert isinstance(found, LinearStart)
    assert torch.equal(found.mean, truth[0])
    assert float(found.modes.square().sum(dim=0).mean().sqrt()) == pytest.approx(0.3)


def test_first_guesses_of_an_ode(make_oscillator: Callable[[], System]) -> None:
    system = make_oscillator()
    damping = Term("p", system.parse("p", "library.p", equation="p"))
    start = prior(system)
    draws = start.draw(30, np.random.default_rng(0))
    states = simulate(system, draws, TIMES)
    members = Ensemble(TIMES, states, torch.zeros(30, 1, dtype=torch.float64))
    truth = simulate(system, torch.tensor([[-0.9, 0.6]], dtype=torch.float64), TIMES)[0]
    readings = record(system, truth, (Sensor("s", "x"),), 0.02)
    guesses = first_guesses(system, start, members, (damping,), readings, None, SETTINGS)
    assert "dashred" not in guesses
    for name in ("blue", "filter"):
        assert guesses[name].size == 2
        assert rms(guesses[name], truth[0]) < 0.1 < rms(guesses["prior"], truth[0])


def test_a_diverged_filter_gives_no_first_guess(make_oscillator: Callable[[], System]) -> None:
    system = make_oscillator()
    growth = Term("p", system.parse("x**3", "library.p", equation="p"))
    start = prior(system)
    states = simulate(system, start.draw(30, np.random.default_rng(0)), TIMES)
    wild = Ensemble(TIMES, states, torch.full((30, 1), 1e6, dtype=torch.float64))
    readings = record(system, states[0], (Sensor("s", "x"),), 0.02)
    guesses = first_guesses(system, start, wild, (growth,), readings, None, SETTINGS)
    assert list(guesses) == ["prior", "blue"]


def test_at_the_deadline_there_is_the_prior_alone(tmp_path: Path) -> None:
    system = linear_system(tmp_path)
    members = ensemble(system, 8)
    readings = record(system, members.states[0], SENSORS, 0.05)
    over = Deadline(0.0)
    guesses = first_guesses(system, prior(system), members, (), readings, None, SETTINGS, over)
    assert list(guesses) == ["prior"]
    with pytest.raises(OutOfTimeError):
        ensemble_filter(
            system,
            members.states[:, 0],
            None,
            (),
            readings.times,
            readings.values,
            readings.operator,
            readings.noise,
            FilterSettings(),
            over,
        )


def test_a_linear_start_is_affine_and_checks_its_shapes() -> None:
    start = LinearStart(torch.ones(2, 3), torch.arange(12.0).reshape(2, 2, 3))
    z = torch.tensor([[0.0, 0.0], [1.0, 0.0], [1.0, 2.0]])
    found = start.start(z)
    assert found.shape == (3, 2, 3)
    assert torch.equal(found[0], start.mean)
    assert torch.equal(found[2] - found[1], 2 * start.modes[1])
    with pytest.raises(ValueError, match="do not fit"):
        replace(start, mean=torch.ones(3))


@pytest.fixture
def make_oscillator(tmp_path: Path) -> Callable[[], System]:
    """A damped oscillator."""
    from dashred.config import load_config

    path = tmp_path / "oscillator.yaml"
    path.write_text("""
system:
  title: a damped oscillator
  fields: {x: place, p: momentum}
  parameters: {k: 2.0}
  equations: {x: p, p: -k*x - 0.1*p}
  start: {x: 1, p: 0}
  spread: {x: 0.1, p: 0.1}
  integrator: {method: rk4, dt: 0.05}
recording: {twin: a, sensors: 1, noise: 0, duration: 4, every: 0.1}
""")
    config = load_config([f"conf={path}"], entry="test")
    return lambda: System(config.system, config.where)


def prior(system: System) -> StartPrior:
    start = nominal_start(system)
    return StartPrior(system, start[0], field_rms(start), None)


def record(system: System, truth: Tensor, sensors: tuple[Sensor, ...], noise: float) -> Readings:
    operator = ObservationOperator(sensors, system)
    generator = torch.Generator().manual_seed(1)
    values = operator(truth)
    values = values + noise * torch.randn(values.shape, generator=generator, dtype=torch.float64)
    return Readings(TIMES, values, operator, torch.full((len(sensors),), noise).double())


def rms(guess: StartModel, truth: Tensor) -> float:
    """Return the error of the centre of a first guess."""
    centre = guess.start(torch.zeros(1, guess.size, dtype=torch.float64))[0]
    return float((centre - truth).square().mean().sqrt())


def unreached(guess: StartModel, truth: Tensor) -> float:
    """Return the rms part of the truth that no z reaches."""
    assert isinstance(guess, LinearStart)
    basis, gap = guess.modes.flatten(1).T, (truth - guess.mean).flatten()
    z = torch.linalg.lstsq(basis, gap[:, None]).solution[:, 0]
    return float((gap - basis @ z).square().mean().sqrt())
