"""A window in a wrong minimum is found by a restart; other laws are unchanged."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest
import torch

from dashred.inference.hypotheses.hypothesis_fit import HypothesisFit
from dashred.inference.hypotheses.windows.window_restarts import (
    SCORE_MARGIN,
    move_window,
    restart_windows,
)
from dashred.physics.window import box, gate, onset
from tests.waves import Waves, in_window

TRUE = 0.2


@pytest.fixture(scope="module")
def stuck(waves: Waves) -> HypothesisFit:
    """A gate whose fit began far from its threshold and ended in a wrong minimum."""
    fit = in_window(waves, gate("u", 1), (TRUE, math.log(0.1)), (1.7, math.log(0.1)))
    assert fit.law.window is not None and abs(fit.law.window.values[0] - TRUE) > 0.5
    return fit


def test_a_gate_is_found_by_a_restart(stuck: HypothesisFit) -> None:
    [found] = restart_windows([stuck])
    assert found.law.window is not None and abs(found.law.window.values[0] - TRUE) < 0.1
    [before], _ = stuck.objective.values(stuck.phi[None])
    [after], _ = found.objective.values(found.phi[None])
    # The score is F plus a penalty, which is the same for both.
    assert found.law.score - stuck.law.score == pytest.approx(float(after - before), rel=1e-6)
    assert found.law.score < stuck.law.score - 100


def test_a_box_is_found_from_another_width(waves: Waves) -> None:
    """A box of half the width with twice the coefficient fits nearly as well."""
    half = 2.0
    right = in_window(waves, box(waves.system.axes[0]), (4.4, half, math.log(0.2)))
    assert right.law.window is not None
    place, width, edge = right.law.window.values
    guess = torch.tensor([place, width / 2, edge], dtype=torch.float64)
    objective = move_window(right.objective, guess)
    phi = right.phi.clone()
    phi[-3:] = 0.0
    phi[-4] *= 2
    [least], _ = right.objective.values(right.phi[None])
    [cost], _ = objective.values(phi[None])
    law = replace(right.law, score=right.law.score + float(cost - least))
    [found] = restart_windows([HypothesisFit(law, objective, phi)])
    assert found.law.window is not None
    assert abs(found.law.window.values[1] - half) < 0.1
    assert found.law.score == pytest.approx(right.law.score, abs=1)
    assert law.score > right.law.score + 10


def test_a_fit_at_its_best_minimum_is_unchanged(waves: Waves) -> None:
    right = in_window(waves, gate("u", 1), (TRUE, math.log(0.1)))
    assert restart_windows([right]) == []
    later = in_window(waves, onset(), (4.0, math.log(0.2)))
    assert restart_windows([later]) == []


def test_a_fit_far_from_the_best_is_not_restarted(stuck: HypothesisFit) -> None:
    best = replace(stuck, law=replace(stuck.law, score=stuck.law.score - SCORE_MARGIN - 1))
    # Only the best of the two is restarted.
    assert len(restart_windows([best, stuck])) == 1
