"""The stages before the free runs of an expensive program leave time for these."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import pytest
import torch

from dashred.core.budget import Budget
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
