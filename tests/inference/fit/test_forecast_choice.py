"""The choice of the smallest law by its forecast."""

from __future__ import annotations

import math

import pytest
import torch

from dashred.inference.fit.forecast_choice import (
    Forecast,
    forecast_of,
    needs_many_terms,
    smallest_sufficient,
)


def test_the_size_of_errors_and_its_standard_error():
    errors = torch.randn((2000, 3), generator=torch.Generator().manual_seed(1)).double()
    forecast = forecast_of(2 * errors)
    assert forecast.rmse == pytest.approx(2.0, rel=0.03)
    # σ/√(2n) for independent errors.
    assert forecast.std == pytest.approx(2 / math.sqrt(2 * 6000), rel=0.6)


def test_missing_readings_are_left_out_and_a_blow_up_is_infinite():
    errors = torch.ones((50, 2), dtype=torch.float64)
    errors[:20] = math.nan
    assert forecast_of(errors).rmse == pytest.approx(1.0)
    errors[-1] = math.inf
    assert forecast_of(errors).rmse == math.inf


@pytest.mark.parametrize(
    ("errors", "chosen"),
    [
        ([5.0, 1.04, 1.0], 1),
        ([5.0, 1.06, 1.0], 2),
        ([1.0, 1.2, 3.0], 0),
        ([math.inf, 2.0, 1.99], 1),
    ],
)
def test_the_smallest_within_five_percent(errors, chosen):
    assert smallest_sufficient([Forecast(error, 0.0) for error in errors]) == chosen


def test_one_standard_error_counts():
    assert smallest_sufficient([Forecast(1.2, 0.1), Forecast(1.0, 0.25)]) == 0


@pytest.mark.parametrize(
    ("without", "few", "many", "needed"),
    [
        (8.0, (8.1, 7.9), 1.1, True),
        (8.0, (8.1, 4.0), 1.1, False),  # a few terms leave a quarter of the squared error
        (8.0, (8.1, 7.9), 3.0, False),  # many terms do not forecast the record either
        (8.0, (math.inf, math.inf), 1.0, True),
        (math.inf, (8.0,), 1.0, False),
        (1.0, (1.0,), 1.0, False),
    ],
)
def test_many_terms_are_needed_where_no_few_forecast_the_record(without, few, many, needed):
    forecasts = [Forecast(each, 0.0) for each in few]
    assert needs_many_terms(Forecast(without, 0.0), forecasts, Forecast(many, 0.0)) is needed
