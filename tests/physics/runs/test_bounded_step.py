"""A law may make the time step too long, or diverge: both are told from each other."""

from __future__ import annotations

from pathlib import Path

import pytest
import torch

from dashred.physics.runs.bounded_step import BoundedStep, bounded_step
from dashred.physics.runs.initial_state_prior import nominal_start
from dashred.physics.system import System, Term
from tests import laws

TEXT = """
system:
  title: a decay
  fields: {x: amount}
  equations: {x: -x}
  start: {x: 1}
  integrator: {method: rk4, dt: 0.5}
recording: {twin: a, sensors: 1, noise: 0, duration: 8, every: 1.0}
"""
RING = """
system:
  title: a ring
  axes: {x: {length: 1, points: 32, ends: periodic}}
  fields: {u: temperature}
  equations: {u: 0.001*d(u, x, 2)}
  start: {u: cos(2*pi*x)}
  integrator: {space: finite-difference, dt: 0.25}
recording: {twin: a, sensors: 1, noise: 0, duration: 8, every: 1.0}
"""
TIMES, RECORDED = torch.arange(13, dtype=torch.float64), 9


def assert_stable(step: BoundedStep) -> None:
    """Check that the simulator is stable with the step that it has."""
    assert step.dt is None and step.diverges is None
    assert step.states is not None and bool(step.states.isfinite().all())


def found(system: System, text: str, value: float) -> BoundedStep:
    """Return the step of a system with a law, from its own start."""
    [field] = system.fields
    term = Term(field, system.parse(text, "test", equation=field))
    [start] = nominal_start(system)
    return bounded_step(system.with_terms([(term, value)]), start, TIMES, RECORDED)


@pytest.fixture(scope="module")
def decay(tmp_path_factory: pytest.TempPathFactory) -> System:
    return laws.declared(tmp_path_factory.mktemp("decay"), TEXT)


def test_a_law_that_the_step_resolves_changes_nothing(decay: System) -> None:
    assert_stable(found(decay, "x", -1.0))
    # An unstable equation, x' = x, grows by 1e5: this is no fault of the step.
    assert_stable(found(decay, "x", 2.0))


def test_a_stiff_law_gets_a_shorter_step(decay: System) -> None:
    """The method of Runge and Kutta is stable for a decay by less than 2.785 in a step."""
    stiff = found(decay, "x", -9.0)
    assert stiff.dt == 0.25 and stiff.diverges is None
    assert stiff.states is not None and float(stiff.states[-1].abs().max()) < 1e-2


def test_a_step_that_amplifies_slowly_is_too_long(decay: System) -> None:
    """With a factor of 1.6 in a step, the run is not yet a million times too large."""
    assert found(decay, "x", -5.2).dt == 0.25


def test_a_law_that_diverges_does_so_with_any_step(decay: System) -> None:
    """``x' = -x + c x³`` from 1 diverges at ``t = ln(c/(c - 1))/2``, here 8.06."""
    lost = found(decay, "x**3", 1 + 1e-7)
    assert lost.dt is None and lost.states is None and lost.diverges == 9.0


def test_a_found_diffusion_gets_a_shorter_step(tmp_path: Path) -> None:
    system = laws.declared(tmp_path, RING)
    assert_stable(found(system, "d(u, x, 2)", 0.0))
    stiff = found(system, "d(u, x, 2)", 0.01)
    assert stiff.dt is not None and stiff.dt < system.dt and stiff.diverges is None
    assert stiff.states is not None and bool(stiff.states.isfinite().all())
