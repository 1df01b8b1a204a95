"""Which seed a walk begins from: the best on sensors, the prior within chance of it."""

from __future__ import annotations

import math

import torch

from dashred.inference.initial_state.start_models import LinearStart
from dashred.pipeline.discovery.first_guess_stage import FittedGuess, ranked

MODEL = LinearStart(torch.zeros(2).double(), torch.eye(2).double())


def seed(name: str, error: float) -> FittedGuess:
    return FittedGuess(name, MODEL, torch.zeros(2).double(), error)


def names(*seeds: FittedGuess, near: float = 1.0) -> list[str]:
    return [found.name for found in ranked(seeds, near)]


def test_the_best_on_validation_comes_first() -> None:
    assert names(seed("blue", 1.4), seed("filter", 1.1), seed("dashred", 9.0)) == [
        "filter",
        "blue",
        "dashred",
    ]


def test_the_prior_goes_before_seeds_that_are_not_far_better() -> None:
    assert names(seed("filter", 1.0), seed("prior", 2.9)) == ["prior", "filter"]
    assert names(seed("filter", 1.0), seed("prior", 3.1)) == ["filter", "prior"]


def test_the_prior_that_is_near_goes_first_however_little_the_noise() -> None:
    assert names(seed("filter", 1.0), seed("prior", 4.3), near=10.0) == ["prior", "filter"]
    assert names(seed("filter", 1.0), seed("prior", 40.0), near=10.0) == ["filter", "prior"]


def test_a_seed_that_was_lost_comes_last() -> None:
    assert names(seed("prior", math.inf), seed("blue", 30.0)) == ["blue", "prior"]
