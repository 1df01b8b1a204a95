"""After the deadline of F, fits stop and keep what they have."""

from __future__ import annotations

import time
from dataclasses import replace

import pytest
import torch

from dashred.core.budget import Deadline, OutOfTimeError
from dashred.inference.fit.growing_horizon import fit_first_horizon, grow_horizon
from dashred.inference.fit.least_squares import LeastSquaresProblem
from dashred.inference.fit.levenberg_marquardt import minimise
from dashred.inference.fit.selection.stepwise_selection import RefittedSet, polish, select
from tests.swing import Swing, noisy

SIGMA = 0.05


@pytest.fixture(scope="module")
def late(swing: Swing) -> LeastSquaresProblem:
    recorded = noisy(swing.clean((0.8, -0.6), ("p**3",), (-0.2,)), SIGMA, seed=1)
    objective = swing.objective(("p**3", "x**3"), recorded, SIGMA, 1.0)
    return replace(objective, deadline=Deadline(time.monotonic() - 1))


def zeros(objective: LeastSquaresProblem) -> torch.Tensor:
    return torch.zeros(objective.modes + len(objective.prior_std), dtype=torch.float64)


def test_a_fit_is_not_begun(late: LeastSquaresProblem) -> None:
    with pytest.raises(OutOfTimeError):
        minimise(late, zeros(late), 5, 1e-4)


def test_a_set_is_returned_as_it_was_fitted(late: LeastSquaresProblem) -> None:
    tried = RefittedSet((0,), zeros(late), 7.0, 9.0)
    assert polish(late, tried, 1e-5) is tried


def test_the_horizon_stays_at_the_first_window(late: LeastSquaresProblem) -> None:
    first = fit_first_horizon(late, zeros(late), 6, 2)
    found = grow_horizon(first, 2, lambda *_: None)
    assert (found.samples, found.is_complete) == (6, False)
    assert len(found.levels) == 1


def test_a_selection_is_not_called_complete(late: LeastSquaresProblem) -> None:
    found = select(late, zeros(late), [], lambda *_: None)
    assert not found.exhausted
    assert () in {tried.members for tried in found.tried}
