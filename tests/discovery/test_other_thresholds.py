"""A gate that was fitted from a wrong threshold is found where it is; other laws are left alone."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest

from dashred.discovery.cause import Cause
from dashred.discovery.other_thresholds import NEAR, from_other_thresholds
from dashred.physics.window import gate, onset
from tests.waves import Waves, in_window

TRUE = 0.2


@pytest.fixture(scope="module")
def stuck(waves: Waves) -> Cause:
    """A gate whose fit began far from its threshold, and ended in a minimum there."""
    cause = in_window(waves, gate("u", 1), (TRUE, math.log(0.1)), (1.7, math.log(0.1)))
    assert cause.law.window is not None and abs(cause.law.window.values[0] - TRUE) > 0.5
    return cause


def test_it_is_found_from_elsewhere(stuck: Cause) -> None:
    [found] = from_other_thresholds([stuck])
    assert found.law.window is not None and abs(found.law.window.values[0] - TRUE) < 0.1
    [before], _ = stuck.objective.values(stuck.phi[None])
    [after], _ = found.objective.values(found.phi[None])
    # A score is F and what the law's freedom costs, which is the same.
    assert found.law.score - stuck.law.score == pytest.approx(float(after - before), rel=1e-6)
    assert found.law.score < stuck.law.score - 100


def test_what_is_at_its_best_stays(waves: Waves) -> None:
    right = in_window(waves, gate("u", 1), (TRUE, math.log(0.1)))
    assert from_other_thresholds([right]) == []
    later = in_window(waves, onset(), (4.0, math.log(0.2)))
    assert from_other_thresholds([later]) == []


def test_what_is_far_from_the_best_is_not_tried(stuck: Cause) -> None:
    best = replace(stuck, law=replace(stuck.law, score=stuck.law.score - NEAR - 1))
    # Of the two only the best is.
    assert len(from_other_thresholds([best, stuck])) == 1
