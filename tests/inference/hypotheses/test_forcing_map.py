"""The map of a free forcing: the place of its maximum, and its standard deviations."""

from __future__ import annotations

import math

import pytest

from dashred.inference.forward.law_block import restrict_to_window
from dashred.inference.hypotheses.forcing_map import build_forcing_map
from dashred.inference.hypotheses.free_forcing import fit_free_forcing
from dashred.physics.window import box
from tests.waves import TIMES, Waves, fitted

SIGMA = 0.01


@pytest.mark.parametrize("middle", [2.5, 7.0])
def test_the_map_is_largest_where_a_law_acts(waves: Waves, middle: float) -> None:
    [axis] = waves.system.axes
    [everywhere] = waves.candidates(["u: 1"])
    [hidden] = restrict_to_window([everywhere], box(axis).at((middle, 1.5, math.log(0.3))))
    objective = waves.objective(waves.recorded(SIGMA, 3, [(hidden, 0.2)]), SIGMA)
    forced, gain = fit_free_forcing(objective, fitted(objective), waves.size)
    found = build_forcing_map(forced, gain)
    assert found is not None and found.gain > 100
    [peak] = found.peak
    assert abs(peak - middle) < 1.5 + 0.5
    assert found.amplitudes.shape == found.stds.shape == (2, len(found.places), len(found.times))
    assert found.times[[0, -1]].tolist() == TIMES[[0, -1]].tolist()
    assert (found.stds > 0).all()


def test_there_is_no_map_if_nothing_is_missing(waves: Waves) -> None:
    objective = waves.objective(waves.recorded(SIGMA, 6), SIGMA)
    forced, gain = fit_free_forcing(objective, fitted(objective), waves.size)
    assert build_forcing_map(forced, gain) is None
