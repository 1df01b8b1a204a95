"""The parts of a record that are searched before any law become longer and longer."""

from __future__ import annotations

import torch

from dashred.inference.hypotheses.first_part import MIN_EXCESS, SHARE, first_parts
from tests.waves import Waves

SIGMA, FIRST = 0.02, 6


def test_each_part_is_longer_than_the_one_before_and_lacks_something(waves: Waves) -> None:
    null = waves.objective(waves.recorded(SIGMA, 1, [(waves.everything["u: u"], -0.25)]), SIGMA)
    phi = torch.zeros(null.modes, dtype=torch.float64)
    parts = list(first_parts(null, phi, FIRST, waves.size))
    lengths = [part.samples for part in parts]
    assert len(lengths) > 1 and lengths == sorted(set(lengths))
    assert lengths[0] >= SHARE * len(null.recorded) and lengths[-1] <= len(null.recorded)
    for part in parts:
        [cost], (_, [residuals]) = part.null.values(part.phi[None])
        assert float(residuals.square().sum()) > part.null.noise.count + MIN_EXCESS
        assert part.forcing.cost < float(cost)


def test_a_record_that_lacks_nothing_has_no_part(waves: Waves) -> None:
    null = waves.objective(waves.recorded(SIGMA, 1), SIGMA)
    phi = torch.zeros(null.modes, dtype=torch.float64)
    assert not list(first_parts(null, phi, FIRST, waves.size))
