"""Formatting of numbers: exactly the significant digits."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from dashred.core.formatting import joined, number, parenthesize_sum, percent, rounded, with_error


@pytest.mark.parametrize(
    ("value", "std", "printed"),
    [
        (-0.0397123, 0.00031, "−0.0397 ± 0.0006"),
        (0.025, 0.0012, "0.025 ± 0.002"),
        (1234.5, 20.0, "1230 ± 40"),
        (0.1, 0.003, "0.100 ± 0.006"),
        (3.21e-7, 2e-8, "3.2e−07 ± 4e−08"),
        (-0.0, 0.2, "0.0 ± 0.4"),
        (0.035, 0.0, "0.035 ± 0"),
        (0.035, float("nan"), "0.035 ± nan"),
    ],
)
def test_a_value_is_rounded_to_its_interval(value: float, std: float, printed: str) -> None:
    assert with_error(value, std) == printed


@given(
    st.floats(min_value=-1e4, max_value=1e4),
    st.floats(min_value=1e-4, max_value=1e3),
)
def test_what_is_rounded_away_is_less_than_the_uncertainty(value: float, std: float) -> None:
    first, second = (float(text.replace("−", "-")) for text in rounded(value, std))
    assert abs(first - value) <= 0.51 * std
    assert second == pytest.approx(std, rel=0.26)


def test_numbers_alone_have_four_digits_and_a_true_minus() -> None:
    assert (number(-0.0351234), number(1e-7), percent(0.394)) == ("−0.03512", "1e−07", "39 %")
    shares = (0.0, 0.0039, 0.0094, 0.0096, 0.996, 1.0)
    assert [*map(percent, shares)] == ["0 %", "0.4 %", "0.9 %", "1 %", "100 %", "100 %"]


@pytest.mark.parametrize(("parts", "text"), [("X", "X"), ("XG", "X and G"), ("XGW", "X, G and W")])
def test_parts_are_joined_as_in_a_sentence(parts: str, text: str) -> None:
    assert joined(list(parts)) == text


@pytest.mark.parametrize(
    ("text", "expected"),
    [("z − T", "(z − T)"), ("z - T", "(z - T)"), ("(u + v)·w", "(u + v)·w"), ("u²", "u²")],
)
def test_a_sum_is_put_in_parentheses(text: str, expected: str) -> None:
    assert parenthesize_sum(text) == expected
