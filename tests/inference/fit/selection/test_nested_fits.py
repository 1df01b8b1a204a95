"""What the fit of a law leaves: noise, a term that is missing, or an unfinished fit."""

from __future__ import annotations

from dataclasses import replace

import pytest
import torch

from dashred.inference.fit.least_squares import LeastSquaresProblem
from dashred.inference.fit.levenberg_marquardt import minimise
from dashred.inference.fit.selection.nested_fits import RoomLeft, room_left
from dashred.inference.fit.selection.stepwise_selection import RefittedSet, polish
from tests.swing import Swing, noisy

SIGMA, NAMES = 0.05, ("k", "c", "x**2", "x**3")


def problem(swing: Swing, law: float, seed: int, believed: float) -> LeastSquaresProblem:
    clean = swing.clean((0.8, -0.6), ("x**3",), (law,)) if law else swing.clean((0.8, -0.6), (), ())
    return swing.objective(NAMES, noisy(clean, SIGMA, seed), believed, 1.0)


def room(objective: LeastSquaresProblem, steps: int = 10) -> RoomLeft:
    """Return what is left beside the empty law."""
    zero = torch.zeros(objective.modes + len(NAMES), dtype=torch.float64)
    free = minimise(objective, zero, 10, 1e-6)
    begin = RefittedSet((), zero, 0.0, 0.0)
    return room_left(
        objective, polish(objective, begin, 1e-6, steps) if steps else begin, free.readings
    )


@pytest.mark.parametrize("believed", [SIGMA, 5 * SIGMA])
def test_what_more_candidates_gain_from_noise_is_insignificant(
    swing: Swing, believed: float
) -> None:
    found = [room(problem(swing, 0.0, seed, believed)) for seed in range(8)]
    assert all(each.decrease < 0.1 for each in found)
    assert sum(each.is_insignificant for each in found) >= 7
    chances = sorted(each.chance for each in found)
    assert chances[-1] > 0.5 > chances[0]


def test_a_missing_term_is_significant_at_any_noise(swing: Swing) -> None:
    """The level of the noise that is believed does not hide it."""
    for believed in (SIGMA, 20 * SIGMA):
        assert room(problem(swing, -0.3, 0, believed)).chance < 1e-3


def test_a_fit_that_has_not_ended_has_room(swing: Swing) -> None:
    begun = room(problem(swing, 0.0, 0, SIGMA), steps=0)
    assert begun.decrease > 10 and not begun.is_insignificant
    assert not replace(begun, chance=0.5).is_insignificant
