"""The library of a search over segments: terms beyond it, and definitions that stay closed."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

from dashred.config import load_config
from dashred.inference.forward.candidates import build_candidates
from dashred.inference.segments.selection.search import SegmentSearch
from dashred.pipeline.discovery.least_squares import build_least_squares, exact_simulator
from dashred.pipeline.discovery.segments.library_choice import search_libraries
from dashred.pipeline.discovery.segments.segment_horizon import follow_segments
from dashred.pipeline.input.build_problem import build_problem
from dashred.pipeline.problem import Problem
from dashred.pipeline.simulation.nominal_run import NominalRun, simulate_nominal

Noise = Callable[[np.random.Generator], NDArray[np.float64]]
Search = Callable[..., tuple[Problem, NominalRun, SegmentSearch]]
TIMES = np.linspace(0, 16, 401)
SPLITS = "splits: {sensors: {validate: 0, test: 0, extra: 0}}\n"
TIGHT = 0.05


def white_noise(rng: np.random.Generator) -> NDArray[np.float64]:
    return 0.01 * rng.standard_normal(len(TIMES))


def smoothed_noise(rng: np.random.Generator) -> NDArray[np.float64]:
    """Noise of a logger that smooths, correlated by 0.95 from sample to sample."""
    noise = rng.standard_normal(len(TIMES))
    for i in range(1, len(TIMES)):
        noise[i] = 0.95 * noise[i - 1] + np.sqrt(1 - 0.95**2) * noise[i]
    return 0.03 * noise


@pytest.fixture
def search(tmp_path: Path) -> Search:
    """Search the law of ``x' = v, v' = tendency`` from readings of some columns."""

    def run(
        system: str,
        tendency: Callable[[float, float], float],
        columns: str = "xv",
        noise: Noise = white_noise,
        **reads: float,
    ) -> tuple[Problem, NominalRun, SegmentSearch]:
        exact = solve_ivp(
            lambda t, u: [u[1], tendency(*u)], (0, 16), [1.0, 0.2], t_eval=TIMES, max_step=0.01
        ).y
        named = dict(zip("xv", exact, strict=True))
        rng = np.random.default_rng(4)
        readings = [reads.get(name, 1.0) * named[name] + noise(rng) for name in columns]
        header = ",".join(["time", *columns])
        table = np.column_stack([TIMES, *readings])
        path = tmp_path / "recording.csv"
        np.savetxt(path, table, delimiter=",", header=header, comments="")
        (tmp_path / "case.yaml").write_text(system + SPLITS + "recording: {path: recording.csv}\n")
        problem = build_problem(load_config([f"conf={tmp_path / 'case.yaml'}"], entry="test"))
        nominal = simulate_nominal(problem, {})
        problem, found = search_libraries(problem, nominal)
        assert found is not None
        return problem, nominal, found

    return run


def names(found: SegmentSearch) -> list[str]:
    return [str(candidate) for candidate in found.terms(found.best)[0]]


SPRING = """
system:
  title: slider on a spring
  fields: {x: position, v: velocity}
  parameters: {k: 4.0, c: 0.05}
  equations: {x: v, v: -k*x - c*v}
  start: {x: 1.0, v: 0.2}
  spread: {x: 0.1, v: 0.1}
  integrator: {method: rk4, dt: 0.02}
"""
POLYNOMIALS = "library: {v: [1, x, v, x**2, x*v, v**2, x**3, v**3]}\n"


def test_dry_friction_beyond_a_library_of_polynomials(search: Search) -> None:
    problem, _, found = search(
        SPRING + POLYNOMIALS, lambda x, v: -4 * x - 0.05 * v - 0.15 * np.sign(v)
    )
    assert names(found) == ["v: sign(v)"]
    assert found.terms(found.best)[1] == pytest.approx([-0.15], abs=0.01)
    assert [str(term) for term in problem.extensions] == ["sign(v)"]


def test_a_law_of_the_library_needs_no_extension(search: Search) -> None:
    problem, _, found = search(SPRING + POLYNOMIALS, lambda x, v: -4 * x - 0.05 * v - 0.3 * x**3)
    assert names(found) == ["v: x**3"]
    assert problem.extensions == ()


def test_a_definition_stays_closed_where_two_sensors_disagree(search: Search) -> None:
    # The sensor of v reads 3 % too little, so x' = v does not hold between the readings.
    _, _, found = search(SPRING, lambda x, v: -4 * x - 0.05 * v, v=0.97)
    assert all(candidate.equation != "x" for candidate in found.problem.candidates)


def test_the_equation_that_defines_an_unmeasured_rate_stays_closed(search: Search) -> None:
    # In x' = -y, y' = x, with x measured, y is minus the rate of x: damping acts on y.
    text = """
system:
  title: harmonic oscillator
  fields: {x: place, y: minus its rate}
  equations: {x: -y, y: x}
  start: {x: 1.0, y: -0.2}
  spread: {x: 0.1, y: 0.2}
  integrator: {method: rk4, dt: 0.02}
"""
    _, _, found = search(text, lambda x, v: -x + v - x * x * v, columns="x")
    assert names(found) == ["y: y", "y: y*x**2"]
    assert found.terms(found.best)[1] == pytest.approx([1.0, -1.0], abs=0.03)


def test_another_unit_of_an_unmeasured_rate_is_no_law(search: Search) -> None:
    # All forces are four times as large. x' = 4 v says so in one term, but x' = v defines v.
    text = """
system:
  title: a stiffening spring
  fields: {x: position, v: velocity}
  equations: {x: v, v: -x - 0.2*x**3}
  start: {x: 1.0, v: 0.2}
  spread: {x: 0.1, v: 0.5}
  integrator: {method: rk4, dt: 0.02}
"""
    _, _, found = search(text, lambda x, v: -4 * x - 0.8 * x**3, columns="x")
    assert names(found) == ["v: x", "v: x**3"]
    assert found.terms(found.best)[1] == pytest.approx([-3.0, -0.6], abs=0.1)


@pytest.mark.parametrize("prior", [3.0, 0.01])
def test_one_trajectory_follows_the_law_of_the_segments(search: Search, prior: float) -> None:
    """The prior, whose scale is that of the simulation, is widened where the law is larger."""
    problem, nominal, found = search(SPRING, lambda x, v: -4 * x - 0.05 * v - 0.3 * x**3)
    candidates = build_candidates(
        problem.system, problem.library, nominal.references[0], problem.times
    )
    simulator = exact_simulator(problem, candidates)
    objective = build_least_squares(problem, simulator, nominal.start, candidates, prior)
    followed = follow_segments(objective, found, TIGHT)
    assert followed is not None
    guess, horizon = followed
    assert horizon.is_complete and horizon.levels[-1][1] == pytest.approx(0.9, abs=0.2)
    [member] = horizon.members
    assert str(candidates[member]) == "v: x**3"
    assert float(horizon.phi[objective.modes + member]) == pytest.approx(-0.3, abs=0.01)
    assert guess.name == "segments"
    wide = horizon.widest * TIGHT * float(candidates[member].scale)
    assert horizon.widened == (member,) and wide >= 0.3 * (1 - 1e-9)


def test_noise_of_a_logger_that_smooths_needs_no_terms(search: Search) -> None:
    _, _, found = search(
        SPRING + POLYNOMIALS,
        lambda x, v: -4 * x - 0.05 * v - 0.3 * x**3,
        noise=smoothed_noise,
    )
    assert names(found) == ["v: x**3"]
    assert not found.errors
