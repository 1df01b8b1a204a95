"""A front is followed around its ring, between grid points and past its seam."""

from __future__ import annotations

import numpy as np
import pytest

from dashred.reporting.figures.fields.front_position import follow_front

LENGTH, POINTS, SPEED, STEEP = 10.0, 128, 1.7, 3.0


def test_place_and_width_of_a_front_that_runs_around_twice() -> None:
    """U falls steeply where a pulse ends: its place is linear in time, its width exact."""
    times = np.linspace(0, 12, 200)
    x = np.arange(POINTS) * LENGTH / POINTS
    turn = 2 * np.pi / LENGTH
    phase = turn * (x[None, :] - SPEED * times[:, None])
    values = np.exp(STEEP * np.cos(phase))
    place, width = follow_front(values, LENGTH)
    np.testing.assert_allclose(place - place[0], SPEED * times, atol=1e-3)
    fine = np.linspace(0, 2 * np.pi, 100_001)
    steepest = np.max(np.abs(STEEP * turn * np.sin(fine) * np.exp(STEEP * np.cos(fine))))
    exact = (np.exp(STEEP) - np.exp(-STEEP)) / steepest
    assert width == pytest.approx(np.full(200, exact), rel=1e-3)


@pytest.mark.parametrize("points", [48, 49])
def test_width_stays_the_same_as_the_front_crosses_the_grid(points: int) -> None:
    """A steep front on few points, at places between them: neither it nor its extent zigzags."""
    phase = 2 * np.pi * (np.arange(points) / points - np.linspace(0, 5 / points, 61)[:, None])
    values = np.exp(STEEP * np.cos(phase))
    place, width = follow_front(values, LENGTH)
    assert np.ptp(width) < 1e-3 * width.mean()
    np.testing.assert_allclose(np.diff(place), LENGTH / points / 12, rtol=1e-2)


def test_what_has_no_slope_has_no_width() -> None:
    place, width = follow_front(np.ones((3, 16)), LENGTH)
    assert not width.any() and np.isfinite(place).all()
