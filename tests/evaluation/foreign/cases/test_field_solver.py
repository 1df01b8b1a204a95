"""The solver of fields, against exact solutions; it needs the extra ``evaluation``."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from dashred.evaluation.foreign.cases.field_equations import FIELD_EQUATIONS
from dashred.evaluation.foreign.cases.field_solver import FieldSolver

pytest.importorskip("pde", reason="py-pde is in the extra evaluation")


def test_a_wave_travels_and_decays_as_the_exact_solution() -> None:
    equation = dataclasses.replace(FIELD_EQUATIONS["advection_diffusion"], cells=256)
    solver = FieldSolver(equation, {"U": 0.7, "D": 0.1, "k": 0.2})
    k = 2 * np.pi / equation.length
    times = np.array([0.0, 1.0, 2.0])
    start = solver.start({"c": "sin(2*pi*x/12)"})
    states = solver.on_points(solver.integrate(equation.terms, start, times))
    places = np.arange(equation.points) * equation.length / equation.points
    for t, state in zip(times, states[:, 0], strict=True):
        exact = np.exp(-(0.1 * k**2 + 0.2) * t) * np.sin(k * (places - 0.7 * t))
        np.testing.assert_allclose(state, exact, atol=2e-4)


def test_operators_in_the_plane() -> None:
    equation = FIELD_EQUATIONS["navier_stokes"]
    solver = FieldSolver(equation, {})
    state = solver.start({"w": "sin(x)*cos(2*y)"})
    for text, exact in (
        ("lap(w)", -5 * state[0]),
        ("inv_lap(w)", -state[0] / 5),
        ("d(w, y)", -2 * np.sin(solver.coordinates["x"]) * np.sin(2 * solver.coordinates["y"])),
    ):
        value = solver.tendency({"w": (text,)})(0.0, state)[0]
        np.testing.assert_allclose(value, exact, atol=4e-3 * np.abs(exact).max())


def test_interpolation_is_exact_for_waves_of_the_grid() -> None:
    equation = FIELD_EQUATIONS["navier_stokes"]
    solver = FieldSolver(equation, {})
    state = solver.start({"w": "cos(x - 2*y + 0.3)"})
    x, y = np.array([0.1, 2.2]), np.array([5.1, 0.4])
    np.testing.assert_allclose(solver.at(state, x, y)[0], np.cos(x - 2 * y + 0.3), atol=1e-12)
    places = np.arange(equation.points) * equation.length / equation.points
    exact = np.cos(places[:, None] - 2 * places + 0.3)
    np.testing.assert_allclose(solver.on_points(state)[0], exact, atol=1e-12)
