"""What the simulator gets wrong from a fitted start is known where the method's factor is."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import pytest
import torch
from torch import Tensor

from dashred.core.findings.fit_schema import LARGEST_OWN_ERROR
from dashred.data.sensors import Sensor
from dashred.inference.fit.law import Law
from dashred.physics.system import System
from dashred.pipeline.simulation.numerical_error import (
    CHECKED_SHARE,
    VISIBLE,
    numerical_error,
    sufficient_step,
)
from tests import laws

TEXT = """
system:
  title: a decay
  fields: {x: amount}
  parameters: {k: 1.0}
  equations: {x: -k*x}
  start: {x: 1}
  integrator: {method: rk4, dt: 0.5}
recording: {twin: a, sensors: 1, noise: 0, duration: 40, every: 1.0}
"""
SIGMA, COUNT = torch.tensor([0.01], dtype=torch.float64), 41


def problem(system: System) -> Any:
    times = torch.arange(COUNT, dtype=torch.float64)
    fit = SimpleNamespace(sensors=[Sensor("s1", "x", ())], names=("s1",), times=times)
    problem = SimpleNamespace(
        system=system,
        times=times,
        split=SimpleNamespace(fit=fit),
    )
    problem.episodes = [problem]
    return problem


def from_start(value: float, damping: Tensor, system: System) -> Law:
    start = torch.tensor([[value]], dtype=torch.float64)
    found = (laws.term(system, "x", "x"),)
    return Law(found, damping, torch.zeros(1, 1).double(), start, 0.0, 1.0, start)


def rk4(z: float) -> float:
    """Return by what one step multiplies a decay."""
    return 1 + z + z**2 / 2 + z**3 / 6 + z**4 / 24


@pytest.mark.parametrize(("start", "added"), [(1.0, 0.0), (-6.0, 0.0), (6.0, -1.2)])
def test_it_is_the_methods_own_in_the_worst_sample_of_the_beginning(tmp_path, start, added) -> None:
    system = laws.declared(tmp_path, TEXT)
    law = from_start(start, torch.tensor([added], dtype=torch.float64), system)
    rate = added - 1.0
    beginning = range(int(CHECKED_SHARE * COUNT) + 1)
    known = [abs(start * (rk4(rate / 2) ** (2 * n) - rk4(rate / 4) ** (4 * n))) for n in beginning]
    assert numerical_error(problem(system), law, SIGMA) == pytest.approx(
        max(known) / float(SIGMA), rel=1e-6
    )


def test_a_law_that_diverges_at_any_resolution_has_none(tmp_path) -> None:
    system = laws.declared(tmp_path, TEXT)
    law = from_start(1e300, torch.tensor([9e3], dtype=torch.float64), system)
    assert numerical_error(problem(system), law, SIGMA) is None
    assert sufficient_step(problem(system), law, SIGMA) is None


def test_of_a_run_that_diverges_at_its_own_step_alone_it_is_the_largest_number(tmp_path) -> None:
    # rk4 is stable for rates up to 2.79/dt: 5.57 at the step of 0.5, 11.1 at half of it.
    system = laws.declared(tmp_path, TEXT)
    law = from_start(1e300, torch.tensor([-9.0], dtype=torch.float64), system)
    assert numerical_error(problem(system), law, SIGMA) == LARGEST_OWN_ERROR


def test_the_longest_step_that_suffices_is_told(tmp_path) -> None:
    system = laws.declared(tmp_path, TEXT)
    law = from_start(6.0, torch.tensor([-1.2], dtype=torch.float64), system)
    whole = problem(system)
    error = numerical_error(whole, law, SIGMA)
    assert error is not None and error > 1
    dt = sufficient_step(whole, law, SIGMA)
    assert dt in (0.125, 0.0625)
    for step, suffices in ((dt, True), (2 * dt, False)):
        whole.system = system.with_step(step)
        error = numerical_error(whole, law, SIGMA)
        assert error is not None and (error <= VISIBLE) == suffices


def test_of_several_episodes_the_worst_one_tells(tmp_path) -> None:
    system = laws.declared(tmp_path, TEXT)
    law = from_start(1.0, torch.zeros(1, dtype=torch.float64), system)
    twice = problem(system)
    alone = numerical_error(twice, law, SIGMA)
    assert alone is not None
    twice.episodes = [twice, twice]
    both = replace(law, start=torch.cat([law.start, 3 * law.start]))
    assert numerical_error(twice, both, SIGMA) == pytest.approx(3 * alone)
