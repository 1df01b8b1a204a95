"""The stages before the free runs of an expensive program leave time for these."""

from __future__ import annotations

import time
from types import SimpleNamespace
from typing import Any

import pytest
import torch

from dashred.core.budget import Budget
from dashred.pipeline.problem import Problem
from dashred.pipeline.time_shares import ENDS, ENDS_OF_SEGMENTS, ends_of

TIMES = 0.1 * torch.arange(61, dtype=torch.float64)


def system(seconds: float | None) -> Any:
    """Return an ODE system with a program that takes so long for each state; None for equations."""
    one_by_one = lambda count: count * seconds  # noqa: E731
    program = None if seconds is None else SimpleNamespace(seconds=seconds, seconds_of=one_by_one)
    return SimpleNamespace(program=program, axes=(), dt=0.1)


@pytest.mark.parametrize("seconds", [None, 1e-3])
def test_other_systems_have_the_usual_shares(seconds: float | None) -> None:
    assert ends_of(system(seconds), TIMES, Budget.begin(300)) == ENDS


@pytest.mark.parametrize(("budget", "latest"), [(600, 0.67), (300, 0.5)])
def test_free_runs_of_an_expensive_program_have_their_time(budget: float, latest: float) -> None:
    # Four runs of 90 steps take 180 s.
    ends = ends_of(system(0.5), TIMES, Budget.begin(budget))
    assert ends["search over segments"] == pytest.approx(latest)
    assert ends["compare hypotheses"] == pytest.approx(latest)
    assert ends["draw figures"] == ENDS_OF_SEGMENTS["draw figures"]
    assert ends["simulate"] == ENDS_OF_SEGMENTS["simulate"]


@pytest.mark.parametrize(("spent", "end"), [(0.1, 0.1 + 0.76 / 4), (0.65, 0.66)])
def test_a_local_cause_has_a_quarter_of_the_rest_of_the_search(spent: float, end: float) -> None:
    budget = Budget(300.0, began=time.monotonic() - 300 * spent)
    problem: Any = SimpleNamespace(system=system(None), times=TIMES, budget=budget)
    deadline = Problem.deadline(problem, "look for a local cause")
    assert deadline.at == pytest.approx(budget.deadline(end).at, abs=1)
