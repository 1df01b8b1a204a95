"""Conversion between units, and units between which there is none."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from dashred.core.errors import InputError
from dashred.core.unit_conversion import UNCHANGED, conversion


def convert(unit: str, other: str):
    return conversion("u", unit, "here", other, "there")


@pytest.mark.parametrize(
    ("unit", "other", "value", "expected"),
    [
        ("deg", "rad", 180.0, np.pi),
        ("°C", "K", 20.0, 293.15),
        ("K", "degC", 293.15, 20.0),
        ("degF", "K", 32.0, 273.15),
        ("km/h", "m s-1", 3.6, 1.0),
        ("rpm", "rad/s", 60.0, 2 * np.pi),
        ("mbar", "Pa", 1.0, 100.0),
        ("L/min", "m3/s", 60000.0, 1.0),
        ("%", "1", 50.0, 0.5),
        ("h", "s", 1.0, 3600.0),
        ("mrad", "rad", 1.0, 1e-3),
        ("krpm", "rad/s", 0.06, 2 * np.pi),
        ("°C/min", "K/s", 60.0, 1.0),
        ("kWh", "J", 1.0, 3.6e6),
        ("W/(m2 K)", "W/(cm2 K)", 1.0, 1e-4),
    ],
)
def test_values_are_converted(unit, other, value, expected):
    assert convert(unit, other)(value) == pytest.approx(expected, rel=1e-9)
    there_and_back = convert(other, unit)(convert(unit, other)(np.array([value])))
    np.testing.assert_allclose(there_and_back, [value], rtol=1e-9)


def test_the_same_unit_changes_nothing():
    values = np.array([0.1])
    assert convert("m/s", "m s^-1") == UNCHANGED and convert("m/s", "m s-1")(values) is values
    assert convert("widgets", "widgets") == UNCHANGED


@pytest.mark.parametrize(
    ("unit", "other"),
    [
        ("m", "s"),
        ("widgets", "m"),
        ("Hz", "rad/s"),
        ("rpm", "Hz"),
        ("krpm", "Hz"),
        ("rps", "Hz"),
        ("gon/s", "Hz"),
        ("mrad/s", "1/s"),
        ("rad", "1"),
        ("dB", "1"),
        ("dBm", "mW"),
    ],
)
def test_units_of_other_quantities_are_refused(unit, other):
    with pytest.raises(InputError, match=f"u is in {unit} here, but in {other} in there"):
        convert(unit, other)


@given(st.text(max_size=12), st.sampled_from(["m", "s", "rad", "K", "1"]))
def test_any_text_is_converted_or_refused(unit, other):
    try:
        found = convert(unit, other)
    except InputError:
        return
    assert np.isfinite(found(1.0)) and found.factor != 0
