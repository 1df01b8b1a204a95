"""Which first guess is followed, and the prior of the selection after the growing horizon."""

from __future__ import annotations

import math
import time
from dataclasses import replace
from types import SimpleNamespace
from typing import NamedTuple, cast

import pytest
import torch
from torch import Tensor

from dashred.core.budget import NEVER, Deadline
from dashred.inference.fit.first_window import SAMPLES, fit_first_window
from dashred.inference.fit.growing_horizon import HorizonFit, fit_first_horizon
from dashred.inference.fit.horizon_state import HorizonState
from dashred.inference.fit.least_squares import LeastSquaresProblem
from dashred.inference.fit.noise_model import NoiseModel
from dashred.inference.forward.episodes import EpisodeStarts
from dashred.inference.initial_state.start_models import LinearStart
from dashred.pipeline.discovery.first_guess_stage import FittedGuess
from dashred.pipeline.discovery.stages.horizon_stage import (
    explaining_guesses_first,
    selection_prior,
)
from tests.swing import FORCES, Swing, noisy

SIGMA, TIGHT, Z = 0.05, 0.05, (0.8, -0.6)


@pytest.mark.parametrize(("widest", "expected"), [(1.0, 1.0), (4.0, 1.0), (64.0, 3.2)])
def test_the_prior_of_the_selection_is_not_narrower_than_that_of_the_horizon(
    widest: float, expected: float
) -> None:
    empty = torch.zeros(0)
    horizon = HorizonFit(empty, (), empty, 6, True, [(6, 1.0)], (0,), widest)
    assert selection_prior(0.05, 1.0, horizon) == pytest.approx(expected)


@pytest.fixture(scope="module")
def swing(tmp_path_factory: pytest.TempPathFactory) -> Swing:
    """Return the compiled swing."""
    return Swing.declared(tmp_path_factory.mktemp("swing"))


class Guesses:
    """First guesses of the start of a swing, and the names of those that were fitted."""

    def __init__(self, swing: Swing) -> None:
        """Record a swing with a force that is among the candidates."""
        self.recorded = noisy(swing.clean(Z, ("x**3",), (-0.3,)), SIGMA, seed=0)
        self.objective = swing.objective(FORCES, self.recorded, SIGMA, TIGHT)
        self.fitted: list[str] = []

    def guess(self, name: str, start: LinearStart) -> FittedGuess:
        """Return a start that is fitted to the first window."""
        model = EpisodeStarts((start,))
        problem = self.objective.with_start(model)
        return FittedGuess(name, model, fit_first_window(problem, self.std).phi, 1.0)

    @property
    def std(self) -> Tensor:
        """Std of each trace."""
        return self.recorded.std(dim=0)

    def fit_first(self, guess: FittedGuess, share: float) -> HorizonState:
        """Fit a share of the first samples from one guess."""
        self.fitted.append(guess.name if share == 1 else f"{guess.name}, {share:g}")
        problem: LeastSquaresProblem = self.objective.with_start(guess.start)
        samples = math.ceil(share * SAMPLES)
        return fit_first_horizon(problem, problem.embed(guess.z, []), samples, len(FORCES))


@pytest.fixture(scope="module")
def guesses(swing: Swing) -> tuple[Guesses, FittedGuess, FittedGuess]:
    """The guesses; one that cannot represent the start, and one that can."""
    made = Guesses(swing)
    confined = LinearStart(swing.estimate.mean, torch.tensor([[0.3, 0.0]], dtype=torch.float64))
    return made, made.guess("confined", confined), made.guess("free", swing.estimate)


def test_a_guess_that_cannot_explain_the_first_samples_is_tried_last(
    guesses: tuple[Guesses, FittedGuess, FittedGuess],
) -> None:
    made, confined, free = guesses
    made.fitted.clear()
    found = explaining_guesses_first([confined, free], made.fit_first, NEVER)
    assert [guess.name for guess, _ in found] == ["free", "confined"]
    assert made.fitted == ["confined", "free"]


def test_no_further_guess_is_fitted_once_one_explains_the_first_samples(
    guesses: tuple[Guesses, FittedGuess, FittedGuess],
) -> None:
    made, confined, free = guesses
    made.fitted.clear()
    guess, first = next(explaining_guesses_first([free, confined], made.fit_first, NEVER))
    assert guess.name == "free" and first.explains_first_samples
    assert made.fitted == ["free"]


class Misfits(NamedTuple):
    """The misfits of the fits from first guesses, by name and share of the first samples."""

    by_guess: dict[tuple[str, float], float]

    def fit_first(self, guess: FittedGuess, share: float) -> HorizonState:
        """Return a fit with the misfit."""
        empty = torch.zeros(0)
        level = 6, self.by_guess[guess.name, share]
        std, read = torch.ones(1).double(), torch.ones(6, 1, dtype=torch.bool)
        noise = NoiseModel(std, torch.zeros_like(std), read)
        known = SimpleNamespace(prior_std=empty, noise=noise)
        objective = cast(LeastSquaresProblem, known)
        return HorizonState(objective, empty, 6, (), levels=[level])


def test_fewer_samples_are_fitted_if_no_guess_explains_the_first_ones(
    guesses: tuple[Guesses, FittedGuess, FittedGuess],
) -> None:
    first, second, third = (replace(guesses[1], name=name) for name in ("1", "2", "3"))
    misfits = Misfits(
        {
            ("1", 1.0): 40.0,
            ("2", 1.0): math.nan,
            ("3", 1.0): 7.0,
            ("1", 0.5): 5.0,
            ("2", 0.5): 0.9,
            ("3", 0.5): math.nan,
        }
    )
    found = [*explaining_guesses_first([first, second, third], misfits.fit_first, NEVER)]
    order = [(guess.name, state.misfit_of_first_samples) for guess, state in found]
    assert order == [("2", 0.9), ("3", 7.0), ("1", 40.0), ("2", math.inf)]


def test_at_the_deadline_one_guess_is_left(
    guesses: tuple[Guesses, FittedGuess, FittedGuess],
) -> None:
    made, confined, free = guesses
    found = explaining_guesses_first(
        [confined, free], made.fit_first, Deadline(time.monotonic() - 1)
    )
    assert [guess.name for guess, _ in found] == ["confined"]
