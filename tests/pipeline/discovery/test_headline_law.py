"""Errors of the forecasts from which the law of the headline is chosen."""

from __future__ import annotations

import math
from types import SimpleNamespace
from typing import Any, cast

import pytest
import torch

from dashred.inference.fit.forecast_choice import forecast_of
from dashred.pipeline.discovery.headline_law import _scaled_errors


@pytest.mark.parametrize(("lost", "expected"), [(False, 2.0), (True, math.inf)])
def test_a_forecast_that_blows_up_is_worse_than_any_other(lost: bool, expected: float) -> None:
    """Its readings are NaN, as are those that the recording does not have."""
    readings = torch.ones((20, 2), dtype=torch.float64)
    available = torch.ones((20, 2), dtype=torch.bool)
    available[3] = False
    recorded = torch.zeros_like(readings).where(available, math.nan)
    if lost:
        readings[8:] = math.nan
    noise = SimpleNamespace(std=torch.tensor([0.5, 0.5]).double(), available=available)
    law = cast(Any, SimpleNamespace(recorded=recorded, noise=noise))
    assert forecast_of(_scaled_errors(law, readings)).rmse == pytest.approx(expected)


def test_a_forecast_without_samples_is_worse_than_any_other() -> None:
    assert forecast_of(torch.full((5, 2), math.nan)).rmse == math.inf
