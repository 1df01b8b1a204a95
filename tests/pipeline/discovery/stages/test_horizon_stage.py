"""The prior of the selection follows that of the growing horizon."""

from __future__ import annotations

import pytest
import torch

from dashred.inference.fit.growing_horizon import HorizonFit
from dashred.pipeline.discovery.stages.horizon_stage import selection_prior


@pytest.mark.parametrize(("widest", "expected"), [(1.0, 1.0), (4.0, 1.0), (64.0, 3.2)])
def test_the_prior_of_the_selection_is_not_narrower_than_that_of_the_horizon(
    widest: float, expected: float
) -> None:
    empty = torch.zeros(0)
    horizon = HorizonFit(empty, (), empty, 6, True, [(6, 1.0)], (0,), widest)
    assert selection_prior(0.05, 1.0, horizon) == pytest.approx(expected)
