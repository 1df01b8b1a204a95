"""Exponents and lines of data whose law is known."""

from __future__ import annotations

import numpy as np
import pytest

from dashred.evaluation.performance.fit import fit_exponent, fit_line


@pytest.mark.parametrize("power", [0.0, 0.3, 1.0, 2.5])
def test_the_exponent_of_a_power_is_exact(power: float) -> None:
    sizes = [8, 16, 64, 256]
    found = fit_exponent(sizes, [0.03 * size**power for size in sizes])
    assert found is not None and found.half_width is not None
    assert found.value == pytest.approx(power, abs=1e-12)
    assert found.half_width == pytest.approx(0.0, abs=1e-6)


def test_the_interval_has_the_width_of_students_distribution() -> None:
    # log₂ y is 0, 1.5, 1.5, 3 over log₂ x of 0, 1, 2, 3: the slope is 0.9 with residuals of
    # -0.15, 0.45, -0.45, 0.15, so that s² = 0.45 / 2 and the error is sqrt(0.225 / 5).
    found = fit_exponent([1, 2, 4, 8], [1, 2**1.5, 2**1.5, 8])
    assert found is not None and found.half_width is not None
    assert found.value == pytest.approx(0.9)
    assert found.half_width == pytest.approx(4.302653 * np.sqrt(0.045), rel=1e-6)


def test_the_interval_covers_the_truth_as_often_as_it_says() -> None:
    generator = np.random.default_rng(0)
    sizes = np.array([8, 16, 32, 64, 128, 256])
    covered = 0
    for _ in range(400):
        noisy = sizes**1.1 * np.exp(0.1 * generator.standard_normal(len(sizes)))
        found = fit_exponent(sizes.tolist(), noisy.tolist())
        assert found is not None and found.half_width is not None
        covered += abs(found.value - 1.1) <= found.half_width
    # 380 are expected, with a standard deviation of 4.4.
    assert 365 <= covered <= 394


def test_too_few_sizes_have_no_interval_or_no_exponent() -> None:
    two = fit_exponent([2, 8], [1.0, 16.0])
    assert two is not None and two.value == pytest.approx(2.0) and two.half_width is None
    assert fit_exponent([4], [1.0]) is None
    assert fit_line([4], [1.0]) is None and fit_line([4, 8], [1.0, 1.0]) is None


def test_the_misfit_of_a_line_is_a_share_of_the_growth() -> None:
    straight = fit_line([1, 2, 3], [410.0, 420.0, 430.0])
    assert straight is not None
    assert straight == pytest.approx((400.0, 10.0, 0.0), abs=1e-9)
    # The mean of a parabola's chord: residuals of 1/3, -2/3, 1/3 over a growth of 4.
    bent = fit_line([0, 1, 2], [0.0, 1.0, 4.0])
    assert bent is not None and bent.misfit == pytest.approx(2 / 3 / 4)
