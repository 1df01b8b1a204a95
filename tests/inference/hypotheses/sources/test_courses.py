"""Courses in time: functions, terms and slopes agree."""

from __future__ import annotations

import math

import numpy as np
import pytest
import torch

from dashred.inference.hypotheses.sources.course_period import course_period
from dashred.inference.hypotheses.sources.courses import (
    Constant,
    Course,
    Free,
    Onset,
    Periodic,
    slopes,
)

TIMES = torch.linspace(0, 6, 61, dtype=torch.float64)
KNOTS = torch.linspace(0, 6, 9, dtype=torch.float64)
COURSES = [
    Constant(),
    Onset(2.5, 0.3),
    Periodic(1.3, 2, 6.0),
    Free(KNOTS, torch.eye(9, dtype=torch.float64)[:, :8]),
]
NAMES = {"sin": np.sin, "cos": np.cos, "tanh": np.tanh, "abs": np.abs}


@pytest.mark.parametrize("course", COURSES)
def test_the_terms_are_the_course(course: Course) -> None:
    functions = course.functions(TIMES)
    amplitudes = torch.linspace(0.5, -1.5, functions.shape[1], dtype=torch.float64)
    terms = course.terms(amplitudes)
    told = sum(
        value * eval(text, {"__builtins__": {}}, NAMES | {"t": TIMES.numpy()})
        for text, value in terms
    )
    np.testing.assert_allclose(told * np.ones(61), functions @ amplitudes, atol=1e-3)


def test_a_free_course_is_constant_outside_of_its_knots() -> None:
    course = Free(KNOTS, torch.eye(9, dtype=torch.float64))
    [(text, value)] = course.terms(torch.arange(9, dtype=torch.float64))
    ends = eval(text, {"__builtins__": {}}, NAMES | {"t": np.array([-3.0, 20.0])})
    np.testing.assert_allclose(value * ends, [0.0, 8.0], atol=1e-3)


def test_slopes_are_derivatives() -> None:
    amplitudes = torch.tensor([0.2, 1.0, 0.5], dtype=torch.float64)
    [slope] = slopes(Periodic(1.3, 1, 6.0), amplitudes, TIMES)
    wanted = TIMES * (torch.cos(1.3 * TIMES) - 0.5 * torch.sin(1.3 * TIMES))
    torch.testing.assert_close(slope, wanted, atol=1e-5, rtol=0)
    assert slopes(Constant(), amplitudes[:1], TIMES) == []


def test_the_second_harmonic_is_a_course_of_its_own() -> None:
    slow = Periodic(1.3, 2, 6.0)
    amplitudes = torch.tensor([0.3, 0.0, 0.0, 1.0, -0.5], dtype=torch.float64)
    fast, own = slow.second_harmonic(amplitudes)
    assert fast.period == pytest.approx(math.pi / 1.3)
    torch.testing.assert_close(fast.functions(TIMES) @ own, slow.functions(TIMES) @ amplitudes)


def test_the_period_of_a_square_wave() -> None:
    times = np.linspace(0, 12, 48)
    noise = 0.05 * np.random.default_rng(0).standard_normal(48)
    found = course_period(times, (np.sin(2 * np.pi * times / 3.7) > 0) + noise)
    assert found is not None
    period, std = found
    assert abs(period - 3.7) < 3 * std < 0.2


@pytest.mark.parametrize("kind", ["noise", "trend", "pulse", "constant"])
def test_a_course_that_does_not_repeat_has_no_period(kind: str) -> None:
    times = np.linspace(0, 12, 48)
    values = {
        "noise": np.random.default_rng(1).standard_normal(48),
        "trend": times,
        "pulse": np.exp(-((times - 4) ** 2)),
        "constant": np.ones(48),
    }
    assert course_period(times, values[kind]) is None
