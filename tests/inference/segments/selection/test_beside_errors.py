"""Sensor errors and forces are found beside a law, and none where there is nothing to find."""

from __future__ import annotations

import numpy as np
import pytest

from dashred.inference.fit.law import Law
from dashred.inference.segments.findings.segment_laws import law_from_segments
from dashred.inference.segments.selection.beside_errors import (
    search_beside_errors,
)
from dashred.inference.segments.selection.search import SegmentSearch
from tests.inference.segments.conftest import NOISE, TIMES, Convection, Find


def beside(found: SegmentSearch) -> tuple[SegmentSearch, Law]:
    again = search_beside_errors(found)
    assert again is not None
    return again, law_from_segments(again, again.best)


@pytest.mark.parametrize(("kind", "size"), [("bias", 1.5), ("drift", 0.2)])
def test_a_steady_error_is_found_beside_the_missing_damping(
    convection: Convection, find: Find, kind: str, size: float
) -> None:
    shape = np.ones_like(TIMES) if kind == "bias" else TIMES
    _, law = beside(find(convection.readings + np.outer(size * shape, [0, 1])))
    assert [str(candidate) for candidate in law.candidates] == ["y: y"]
    assert float(law.coefficients[0]) == pytest.approx(-1.0, abs=0.05)
    [fault] = law.faults
    assert (fault.kind, fault.sensor) == (kind, "y")
    assert fault.std is not None and fault.std < 0.1 * size
    assert fault.value == pytest.approx(size, abs=4 * fault.std)


def test_an_error_of_any_shape_is_found_as_a_curve(convection: Convection, find: Find) -> None:
    error = TIMES / 6 * np.sin(1.6 * TIMES)
    _, law = beside(find(convection.readings + np.outer(error, [1, 0])))
    assert [str(candidate) for candidate in law.candidates] == ["y: y"]
    [fault] = law.faults
    assert (fault.kind, fault.sensor) == ("wandering", "x")
    [curve] = fault.curves
    exact = np.interp(curve.times, TIMES, error)
    off = (np.array(curve.value) - exact) / np.array(curve.std)
    assert np.sqrt(np.mean(off**2)) < 1.5 and max(curve.std) < 3 * NOISE


def test_an_error_that_comes_and_goes(convection: Convection, find: Find) -> None:
    error = np.where((TIMES > 4.07) & (TIMES < 7.3), 2.0, 0.0)
    again, law = beside(find(convection.readings + np.outer(error, [0, 1])))
    assert [str(candidate) for candidate in law.candidates] == ["y: y"]
    assert [fault.sensor for fault in law.faults] == ["y"]
    # The readings at which the error jumps within a segment are left out.
    lost = find(convection.readings).problem.segments.seen - again.problem.segments.seen
    assert 0 < lost < 12


def test_sound_sensors_and_a_law_need_no_errors(convection: Convection, find: Find) -> None:
    assert search_beside_errors(find(convection.readings)) is None


@pytest.mark.parametrize("second", [1.0, 0.0])
def test_an_error_that_is_the_same_in_every_episode_is_none(
    convection: Convection, find: Find, second: float
) -> None:
    noise = NOISE * np.random.default_rng(5).standard_normal(convection.readings.shape)
    error = np.outer(TIMES / 6 * np.sin(1.6 * TIMES), [1, 0])
    episodes = convection.readings + error, convection.states[:, :2] + noise + second * error
    again = search_beside_errors(find(*episodes))
    assert (again is None) == (second == 1.0)
