"""Wilson's intervals against published ones, and how shares read."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from dashred.evaluation.proof.scoring.statistics import Rate, median_of, percent, wilson


@pytest.mark.parametrize(
    ("successes", "n", "low", "high"),
    # R. G. Newcombe, Statistics in Medicine 17 (1998) 857-872, table I, method 3.
    [
        (81, 263, 0.2553, 0.3662),
        (15, 148, 0.0624, 0.1605),
        (0, 20, 0, 0.1611),
        (1, 29, 0.0061, 0.1718),
    ],
)
def test_wilsons_interval_is_the_published_one(
    successes: int, n: int, low: float, high: float
) -> None:
    assert wilson(successes, n) == pytest.approx((low, high), abs=6e-5)


@given(st.integers(1, 300).flatmap(lambda n: st.tuples(st.integers(0, n), st.just(n))))
def test_the_interval_lies_in_0_to_1_about_the_share_and_is_the_same_from_the_other_side(
    counts: tuple[int, int],
) -> None:
    successes, n = counts
    rate, other = Rate(successes, n), Rate(n - successes, n)
    assert 0 <= rate.low <= rate.share <= rate.high <= 1
    assert (rate.low, rate.high) == pytest.approx((1 - other.high, 1 - other.low))


def test_of_nothing_nothing_is_known() -> None:
    nothing = Rate.of([None, None])
    assert nothing == Rate(0, 0)
    assert math.isnan(nothing.share)
    assert (nothing.low, nothing.high) == (0, 1)
    assert (str(nothing), nothing.interval) == ("–", "")


def test_what_is_unknown_does_not_count() -> None:
    assert Rate.of([True, None, False, True]) == Rate(2, 3)
    assert median_of([3.0, None, 1.0, 8.0]) == (3.0, 3)
    assert median_of([None]) == (None, 0)


def test_a_rate_reads_as_in_a_table() -> None:
    assert str(Rate(31, 36)) == "31/36 = 86 % (71-94 %)"
    assert str(Rate(36, 36)) == "36/36 = 100 % (90-100 %)"
    assert str(Rate(4, 120)) == "4/120 = 3.3 % (1.3-8.3 %)"


@pytest.mark.parametrize(
    ("share", "text"),
    [(0, "0"), (0.0333, "3.3"), (0.0996, "10"), (0.86, "86"), (0.996, "100"), (-0.4, "-40")],
)
def test_shares_have_two_digits_and_no_exponent(share: float, text: str) -> None:
    assert percent(share) == text
