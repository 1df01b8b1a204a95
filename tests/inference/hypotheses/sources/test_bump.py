"""A bump in space: its form, its text, its integral and its region."""

from __future__ import annotations

import math
from pathlib import Path

import pytest
import torch

from dashred.inference.hypotheses.sources.bump import Bump
from tests import laws
from tests.channel import Channel

PLANE = laws.TEXT.replace(
    "{x: {length: 2*pi, points: 32}}", "{x: {length: 6, points: 32}, y: {length: 4, points: 32}}"
)
ENDS = laws.TEXT.replace("points: 32", "points: 32, ends: fixed")


def test_a_narrow_bump_is_a_normal_distribution(channel: Channel) -> None:
    bump, x = Bump((3.0,), 0.4), channel.system.grid.coordinates["x"]
    found = bump.on_grid(channel.system)
    torch.testing.assert_close(found, torch.exp(-(((x - 3) / 0.4) ** 2) / 2), atol=0.01, rtol=0)
    assert bump.integral(channel.system) == pytest.approx(0.4 * math.sqrt(2 * math.pi), rel=0.01)


@pytest.mark.parametrize("centre", [3.3, 9.9])
def test_the_text_is_the_bump(channel: Channel, centre: float) -> None:
    bump = Bump((centre,), 0.5)
    state = torch.zeros((1, *channel.system.grid.shape), dtype=torch.float64)
    told = channel.system.evaluate(bump.text(channel.system), state)
    torch.testing.assert_close(told.squeeze(), bump.on_grid(channel.system), atol=1e-4, rtol=0)


def test_a_bump_in_the_plane_is_a_product(tmp_path: Path) -> None:
    system = laws.declared(tmp_path, PLANE)
    bump = Bump((2.0, 1.0), 0.3)
    found = bump.on_grid(system)
    assert divmod(int(found.argmax()), 32) == (11, 8)
    assert bump.integral(system) == pytest.approx(2 * math.pi * 0.09, rel=0.06)
    assert len(bump.slopes(system)) == 3


def test_a_bump_between_fixed_ends_is_odd(tmp_path: Path) -> None:
    system = laws.declared(tmp_path, ENDS)
    found = Bump((2.0,), 0.3).on_grid(system)
    torch.testing.assert_close(found[1:], -found[1:].flip(0))
    assert Bump((2.0,), 0.3).integral(system) == pytest.approx(0.3 * math.sqrt(2 * math.pi), 0.01)


def test_slopes_are_those_of_a_normal_distribution(channel: Channel) -> None:
    bump, x = Bump((4.0,), 0.4), channel.system.grid.coordinates["x"]
    by_centre, by_log_width = bump.slopes(channel.system)
    b, away = bump.on_grid(channel.system), (x - 4) / 0.4
    torch.testing.assert_close(by_centre, b * away / 0.4, atol=0.05, rtol=0)
    torch.testing.assert_close(by_log_width, b * away**2, atol=0.02, rtol=0)


def test_a_region_wraps_around_a_ring_and_ends_at_an_end(channel: Channel, tmp_path: Path) -> None:
    [ring], [line] = channel.system.axes, laws.declared(tmp_path, ENDS).axes
    begin, end = Bump((0.2,), 0.3).region(ring, 0)
    assert begin == pytest.approx(9.612) and end == pytest.approx(0.788)
    assert Bump((0.2,), 0.3).region(line, 0) == pytest.approx((0.0, 0.788))
    assert Bump((3.0,), 4.0).region(ring, 0) == (0.0, 10.0)
    assert Bump((10.4,), 0.3).within(channel.system).centre == pytest.approx((0.4,))
