"""Recordings with uneven times are compared at these times."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from dashred.config import load_config
from dashred.pipeline.discovery.segments.segment_search import search_library
from dashred.pipeline.input.build_problem import build_problem
from dashred.pipeline.problem import Problem
from dashred.pipeline.simulation.nominal_run import simulate_nominal
from tests.pipeline.simulation.conftest import SHORT_RUN

PREY = """
system:
  title: prey and predator
  fields: {a: prey, b: predator}
  equations: {a: 0.8*a - 0.5*a*b, b: -0.6*b + 0.4*a*b}
  start: {a: 1.5, b: 1.0}
  spread: {a: 0.1, b: 0.1}
recording: {path: r.csv}
"""
# The coefficient of a**2 in the equation of a.
TERM = -0.06
DOSES = (
    """
system:
  title: a drug
  fields: {g: amount in the gut, c: concentration}
  parameters: {ka: 1.5}
  equations: {g: -ka*g, c: ka*g}
  start: {g: 8, c: 0.1}
  spread: {g: 3, c: 0.5}
library: {c: [c, c**2]}
recording: {path: r.csv}"""
    + SHORT_RUN
)


def prey(times: np.ndarray) -> np.ndarray:
    def tendency(_: float, u: np.ndarray) -> list[float]:
        a, b = u
        return [0.8 * a - 0.5 * a * b + TERM * a**2, -0.6 * b + 0.4 * a * b]

    solved = solve_ivp(tendency, (0, 41), [1.5, 1.0], dense_output=True, rtol=1e-9, atol=1e-9)
    assert solved.sol is not None
    found: np.ndarray = solved.sol(times).T
    return found + 0.02 * np.random.default_rng(4).standard_normal(found.shape)


def problem_of(folder: Path, rows: list[str], *words: str) -> Problem:
    (folder / "r.csv").write_text("\n".join(["time,a,b", *rows]) + "\n")
    (folder / "prey.yaml").write_text(PREY)
    return build_problem(load_config([f"conf={folder / 'prey.yaml'}", *words], entry="train"))


def at_random_times() -> list[str]:
    times = np.sort(np.random.default_rng(2).uniform(0, 40, 200))
    return [f"{t:.4f},{a:.5f},{b:.5f}" for t, (a, b) in zip(times, prey(times), strict=True)]


def with_two_loggers() -> list[str]:
    first, late = 0.2 * np.arange(200), 0.2 * np.arange(200) + 0.03
    rows = [(t, f"{t:.3f},{a:.5f},") for t, (a, _) in zip(first, prey(first), strict=True)]
    rows += [(t, f"{t:.3f},,{b:.5f}") for t, (_, b) in zip(late, prey(late), strict=True)]
    return [row for _, row in sorted(rows)]


@pytest.mark.parametrize("rows", [at_random_times(), with_two_loggers()])
def test_the_law_is_found_at_the_times_of_the_samples(tmp_path: Path, rows: list[str]) -> None:
    problem = problem_of(tmp_path, rows)
    assert len(problem.times) == len(rows)
    assert problem.clock.startswith(f"kept the times of {len(rows)} samples")
    found = search_library(problem, simulate_nominal(problem, {}))
    assert found is not None
    [candidate], [coefficient] = found.terms(found.best)
    assert str(candidate) == "a: a**2"
    assert coefficient == pytest.approx(TERM, abs=0.003)


def test_a_stated_step_makes_a_clock(tmp_path: Path) -> None:
    problem = problem_of(tmp_path, with_two_loggers(), "recording.every=0.2")
    np.testing.assert_allclose(np.diff(problem.times.numpy()), 0.2, rtol=1e-9)


@pytest.mark.slow
def test_twelve_subjects_with_eleven_samples_each_have_a_law(tmp_path: Path, train) -> None:
    nominal = np.array([0, 0.25, 0.57, 1.12, 2.02, 3.82, 5.1, 7.03, 9.05, 12.12, 24.37])
    rng, rows = np.random.default_rng(8), ["episode,time,c"]
    for subject in range(12):
        times = nominal * (1 + 0.02 * rng.standard_normal(11))
        dose = 8 + 1.5 * rng.standard_normal()
        solved = solve_ivp(
            lambda _, u: [-1.5 * u[0], 1.5 * u[0] - 0.09 * u[1]],
            (0, 30),
            [dose, 0.3],
            t_eval=times,
            rtol=1e-9,
            atol=1e-9,
        )
        readings = solved.y[1] + 0.1 * rng.standard_normal(11)
        rows += [f"s{subject},{t:.3f},{c:.4f}" for t, c in zip(times, readings, strict=True)]
    (tmp_path / "r.csv").write_text("\n".join(rows) + "\n")
    (tmp_path / "doses.yaml").write_text(DOSES)
    ended = train(f"conf={tmp_path / 'doses.yaml'}", f"recording.path={tmp_path / 'r.csv'}")
    assert ended.code == 0, ended.err
    findings = json.loads(ended.read("findings.json"))
    assert findings["verdict"] == "missing-term"
    [term] = findings["terms"]
    assert (term["equation"], term["term"]) == ("c", "c")
    low, high = term["ci95"]
    assert low < -0.09 < high
