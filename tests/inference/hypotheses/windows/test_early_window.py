"""A term in a window is found before any law; a term that acts everywhere is left to the search."""

from __future__ import annotations

import math
from typing import Any

import pytest
import torch

from dashred.inference.forward.candidates import Candidate
from dashred.inference.forward.law_block import restrict_to_window
from dashred.inference.hypotheses.first_part import first_parts
from dashred.inference.hypotheses.hypothesis_fit import HypothesisFit
from dashred.inference.hypotheses.windows import early_window
from dashred.inference.hypotheses.windows.early_window import find_early_window
from dashred.physics.window import box
from tests.waves import Waves

SIGMA, FIRST = 0.02, 6
PLACE, HALF_WIDTH = 4.4, 1.8


def search(waves: Waves, hidden: list[tuple[Candidate, float]]) -> HypothesisFit | None:
    """Search in a recording under hidden terms."""
    recorded = waves.recorded(SIGMA, 1, hidden)
    null = waves.objective(recorded, SIGMA)
    phi = torch.zeros(null.modes, dtype=torch.float64)
    part = next(first_parts(null, phi, FIRST, waves.size), None)
    if part is None:
        return None
    everything = waves.objective(recorded, SIGMA, list(waves.everything))
    count = len(waves.everything)
    return find_early_window(everything, part, count, lambda share, text: None)


def test_a_term_in_a_box_is_followed_to_the_end(waves: Waves) -> None:
    edges = [PLACE, HALF_WIDTH, math.log(0.3)]
    hidden = restrict_to_window(waves.candidates(["u: u**3"]), box(waves.system.axes[0]).at(edges))
    found = search(waves, [(hidden[0], -0.3)])
    assert found is not None and found.law.window is not None
    [candidate] = found.law.candidates
    assert candidate.key == "u: u**3"
    assert float(found.law.coefficients[0]) == pytest.approx(-0.3, rel=0.15)
    assert len(found.law.residuals) == len(found.objective.recorded)
    assert found.law.chi2 < 1.2


def test_a_term_that_acts_everywhere_is_left_to_the_search(waves: Waves) -> None:
    assert search(waves, [(waves.everything["u: u**2"], -0.15)]) is None


def test_nothing_is_missing(waves: Waves) -> None:
    assert search(waves, []) is None


def test_a_window_that_covers_the_record_is_left_to_the_search(
    waves: Waves, monkeypatch: pytest.MonkeyPatch
) -> None:
    compared: list[tuple[Any, ...]] = []

    def is_as_good(*arguments: Any) -> bool:
        compared.append(arguments)
        return False

    with monkeypatch.context() as patched:
        patched.setattr(early_window, "_is_as_good_everywhere", is_as_good)
        # Windows are fitted although the linearised problem does not prefer them.
        patched.setattr(early_window, "MARGIN", -1e9)
        assert search(waves, [(waves.everything["u: u**2"], -0.15)]) is not None
    [arguments] = compared
    assert early_window._is_as_good_everywhere(*arguments)


def test_a_window_that_covers_a_part_of_the_axis_is_not_as_good_everywhere(
    waves: Waves, monkeypatch: pytest.MonkeyPatch
) -> None:
    answers: list[bool] = []
    is_as_good = early_window._is_as_good_everywhere

    def recorded(*arguments: Any) -> bool:
        answers.append(is_as_good(*arguments))
        return answers[-1]

    monkeypatch.setattr(early_window, "_is_as_good_everywhere", recorded)
    edges = [PLACE, HALF_WIDTH, math.log(0.3)]
    hidden = restrict_to_window(waves.candidates(["u: u**3"]), box(waves.system.axes[0]).at(edges))
    assert search(waves, [(hidden[0], -0.3)]) is not None
    assert answers == [False]
