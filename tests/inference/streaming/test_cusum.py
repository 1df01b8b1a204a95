"""Charts: the run lengths of the literature, and the rate of false alarms of white noise."""

from __future__ import annotations

import numpy as np
import pytest

from dashred.inference.streaming.cusum import Charts, run_length, threshold_of


@pytest.mark.parametrize(
    ("threshold", "two_sided"),
    # Montgomery, Introduction to Statistical Quality Control, table 9.3: k = 1/2, no shift.
    [(4.0, 168.0), (5.0, 465.0)],
)
def test_run_lengths_are_those_of_the_literature(threshold: float, two_sided: float) -> None:
    assert run_length(threshold, 0.5) / 2 == pytest.approx(two_sided, rel=2e-3)


def test_run_length_is_close_to_siegmunds_approximation() -> None:
    b = 8.0 + 1.166
    siegmund = 2 * (np.exp(b) - b - 1)
    assert run_length(8.0, 0.5) == pytest.approx(siegmund, rel=0.03)


@pytest.mark.parametrize("rate", [0.05, 1e-4, 1e-8])
def test_the_threshold_has_the_rate(rate: float) -> None:
    assert run_length(threshold_of(rate)) == pytest.approx(1 / rate, rel=1e-4)


def test_white_noise_raises_alarms_at_the_stated_rate() -> None:
    charts, rng = Charts(5, 0.005), np.random.default_rng(0)
    alarms, samples = 0, 40_000
    for noise in rng.standard_normal((samples, 2)):
        # Two sensors on both sides, and a third variable.
        charts.add(np.concatenate([noise, -noise, rng.standard_normal(1)]))
        if charts.alarms.any():
            alarms += 1
            charts.begin_again()
    # 200 expected; all charts begin again at an alarm, which makes the others a little rarer.
    assert alarms == pytest.approx(200, abs=45)


def test_a_chart_knows_when_it_left_zero() -> None:
    charts = Charts(1, 1e-4)
    for _ in range(10):
        charts.add(np.array([-3.0]))
    for _ in range(4):
        charts.add(np.array([4.0]))
    assert charts.samples == 14 and charts.zeros[0] == 10 and charts.alarms[0]


def test_one_outlier_and_missing_values_are_no_alarm() -> None:
    charts = Charts(1, 1e-4)
    charts.add(np.array([1e6]))
    before = charts.sums.copy()
    charts.add(np.array([np.nan]))
    assert not charts.alarms.any() and charts.sums == before


def test_an_alarm_can_end() -> None:
    charts = Charts(1, 1e-4)
    for _ in range(10_000):
        charts.add(np.array([4.0]))
    for _ in range(60):
        charts.add(np.array([0.0]))
    assert charts.sums[0] == 0
