"""Units are compared, multiplied and written as products of powers, without conversion."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from dashred.core.errors import InputError
from dashred.core.units import (
    ONE,
    check_same_unit,
    check_unit,
    format_unit,
    label_with_unit,
    parse_unit,
    per_unit,
    same_unit,
    split_unit,
)


@pytest.mark.parametrize(
    "spelling", ["m/s", "m s-1", " m  s^-1", "m*s**-1", "m·s⁻¹", "s-1 m", "m2/(m s)", "m.s-1"]
)
def test_spellings_of_one_unit_are_equal(spelling: str) -> None:
    assert same_unit(spelling, "m/s")


@pytest.mark.parametrize("other", ["km/s", "m/s2", "s/m", "m / sec", "1000 m/s", "M/s", "1"])
def test_another_symbol_or_power_is_another_unit(other: str) -> None:
    assert not same_unit(other, "m/s")


@pytest.mark.parametrize(
    ("text", "written", "printed"),
    [
        ("rad s-2", "rad/s^2", "rad/s²"),
        ("m2 s-1", "m^2/s", "m²/s"),
        ("kg*m/s", "kg m/s", "kg·m/s"),
        ("W/(m2 K)", "W/(m^2 K)", "W/(m²·K)"),
        ("s-1", "1/s", "1/s"),
        ("1", "1", "1"),
        ("°C", "°C", "°C"),
        ("%", "%", "%"),
        ("m^0.5", "m^0.5", "m^0.5"),
        ("10 cm", "10 cm", "10 cm"),
    ],
)
def test_a_unit_is_written_in_one_way(text: str, written: str, printed: str) -> None:
    assert str(parse_unit(text)) == written
    assert format_unit(text) == printed


def test_units_multiply_and_cancel() -> None:
    rad, s = parse_unit("rad"), parse_unit("s")
    assert str(rad / s / s) == "rad/s^2"
    assert (rad / s) ** 2 * s * s == rad**2
    assert rad / rad == ONE
    assert rad**0 == ONE
    assert str(parse_unit("10 cm") / s**2) == "(10 cm)/s^2"


def test_one_over_a_symbol_is_written_in_words() -> None:
    assert per_unit("1/s") == per_unit("s-1") == "per s"
    assert per_unit("m/s") is None
    assert per_unit("s-2") is None


@pytest.mark.parametrize(
    ("header", "name", "unit"),
    [
        ("theta [rad]", "theta", "rad"),
        (" theta[rad/s] ", "theta", "rad/s"),
        ("theta", "theta", None),
        ("theta (left)", "theta (left)", None),
        ("a[0] [m]", "a[0]", "m"),
        ("u []", "u", ""),
    ],
)
def test_a_header_is_a_name_and_a_unit(header: str, name: str, unit: str | None) -> None:
    assert split_unit(header) == (name, unit)


@pytest.mark.parametrize("unit", ["", " ", "a\nb", "m]", "x" * 61])
def test_what_is_no_unit_is_refused(unit: str) -> None:
    with pytest.raises(InputError, match="unit of u"):
        check_unit(unit, "u", "a.yaml:3")


def test_units_that_differ_are_refused_with_both_places() -> None:
    with pytest.raises(InputError, match=r"a.csv:1: theta is in deg here, but in rad in b.yaml:4"):
        check_same_unit("theta", "deg", "a.csv:1", "rad", "b.yaml:4")
    check_same_unit("theta", "m s-1", "a.csv:1", "m/s", "b.yaml:4")
    check_same_unit("theta", "m s-1", "a.csv:1", None, "b.yaml:4")


def test_a_label_has_its_unit_in_brackets() -> None:
    assert label_with_unit("theta", "rad s-1") == "theta [rad/s]"
    assert label_with_unit("time", None) == "time"


@given(st.text(max_size=60))
def test_any_text_is_a_unit_equal_to_itself(text: str) -> None:
    unit = parse_unit(text)
    assert unit == parse_unit(text)
    assert parse_unit(str(unit)) == unit or "(" in str(unit)
