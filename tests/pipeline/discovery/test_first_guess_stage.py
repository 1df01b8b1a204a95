"""Which first guess a walk begins from: the best on sensors, the prior within chance of it."""

from __future__ import annotations

import math

import torch

from dashred.inference.initial_state.start_models import LinearStart
from dashred.pipeline.discovery.first_guess_stage import FittedGuess, rank_guesses

MODEL = LinearStart(torch.zeros(2).double(), torch.eye(2).double())


def guess(name: str, error: float) -> FittedGuess:
    return FittedGuess(name, MODEL, torch.zeros(2).double(), error)


def names(*guesses: FittedGuess, near: float = 1.0) -> list[str]:
    return [found.name for found in rank_guesses(guesses, near)]


def test_the_best_on_validation_comes_first() -> None:
    assert names(guess("blue", 1.4), guess("filter", 1.1), guess("dashred", 9.0)) == [
        "filter",
        "blue",
        "dashred",
    ]


def test_the_prior_goes_before_seeds_that_are_not_far_better() -> None:
    assert names(guess("filter", 1.0), guess("prior", 2.9)) == ["prior", "filter"]
    assert names(guess("filter", 1.0), guess("prior", 3.1)) == ["filter", "prior"]


def test_the_prior_that_is_near_goes_first_however_little_the_noise() -> None:
    assert names(guess("filter", 1.0), guess("prior", 4.3), near=10.0) == ["prior", "filter"]
    assert names(guess("filter", 1.0), guess("prior", 40.0), near=10.0) == ["filter", "prior"]


def test_a_seed_that_was_lost_comes_last() -> None:
    assert names(guess("prior", math.inf), guess("blue", 30.0)) == ["blue", "prior"]
