"""Candidates: no collinear ones, parameters before terms, scales and limits as defined."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import pytest
import torch
from torch import Tensor

from dashred.inference.forward.candidates import (
    Candidate,
    build_candidates,
    build_forcing,
    indices_by_name,
)
from dashred.physics.runs.initial_state_prior import nominal_start
from dashred.physics.solvers.simulate import simulate
from dashred.physics.system import System, Term
from dashred.physics.terms.library import evaluate_terms
from tests import laws

# Koch's model: conf/rde.yaml on fewer points.
ENGINE = """
system:
  title: Rotating detonation engine
  axes: {x: {length: 2*pi, points: 48}}
  fields: {u: internal energy, lam: combustion progress}
  parameters: {q: 1.0, k: 1.0, u_c: 1.1, alpha: 0.3, eps: 0.28, s: 4.5, u_p: 0.5, nu: 0.1}
  let: {rate: k*exp((u - u_c)/alpha)}
  equations:
    u: -d(u**2/2, x) + q*rate*(1 - lam) - eps*u**2 + nu*lap(u)
    lam: rate*(1 - lam) - s*u_p/(1 + exp(5*(u - u_p)))*lam + nu*lap(lam)
  start: {u: 0.6 + 0.3*sin(x), lam: 0.75 + 0.1*cos(2*x)}
  integrator: {dt: 0.02}
recording: {twin: a, sensors: 4, noise: 0, duration: 4, every: 0.1}
"""
RING = """
system:
  title: ring
  axes: {x: {length: 4*pi, points: 24}}
  fields: {u: height, v: speed}
  equations: {u: "-u*d(u, x) + 0.5*lap(u) + v", v: "-v - u"}
  start: {u: 1 + sin(x/2), v: cos(x) + 0.5*sin(x/2)}
  integrator: {dt: 0.05}
recording: {twin: a, sensors: 4, noise: 0, duration: 4, every: 0.1}
"""
ALONE = """
system:
  title: one field
  axes: {x: {length: 2*pi, points: 24}}
  fields: {u: height}
  parameters: {c: 0.7}
  equations: {u: "-c*d(u, x) + 0.1*lap(u) - 0.2*u**3"}
  start: {u: 1 + sin(x)}
  integrator: {dt: 0.05}
recording: {twin: a, sensors: 4, noise: 0, duration: 4, every: 0.1}
"""
STILL = """
system:
  title: no reaction
  fields: {a: reactant}
  equations: {a: 0}
  start: {a: 2}
  spread: {a: 0.1}
  integrator: {method: rk4, dt: 0.1}
recording: {twin: a, sensors: 1, noise: 0, duration: 4, every: 0.25}
"""
LIBRARY = {
    "u": ["1", "u", "u**2", "u**3", "lap(u)", "lam", "d(u, x)", "u*d(u, x)"],
    "lam": ["lam", "u**2", "lap(lam)"],
}
TIMES = torch.linspace(0, 1, 5, dtype=torch.float64)


def library(system: System, texts: dict[str, list[str]]) -> list[Term]:
    return [
        Term(e, system.parse(text, f"library.{e}", equation=e))
        for e, listed in texts.items()
        for text in listed
    ]


def nominal(system: System) -> Tensor:
    return simulate(system, nominal_start(system), TIMES)[0]


@pytest.fixture(scope="module")
def engine(tmp_path_factory: pytest.TempPathFactory) -> System:
    return laws.declared(tmp_path_factory.mktemp("engine"), ENGINE)


@pytest.fixture(scope="module")
def found(engine: System) -> list[Candidate]:
    return build_candidates(engine, library(engine, LIBRARY), nominal(engine), 0.0)


def test_parameters_come_first_and_replace_proportional_terms(found: list[Candidate]) -> None:
    names = [str(candidate) for candidate in found]
    parameters = ["q", "k", "alpha", "eps", "s", "u_p", "nu"]
    terms = ["1", "u", "u**3", "d(u, x, 2)", "lam", "d(u, x)", "u*d(u, x)"]
    rest = ["lam: lam", "lam: u**2", "lam: d(lam, x, 2)"]
    assert names[:7] == [f"parameter {name}" for name in parameters]
    assert names[7:] == [f"u: {text}" for text in terms] + rest
    [eps] = [c for c in found if c.name == "eps"]
    assert eps.replaces == ("u: u**2",) and eps.equation is None
    assert all(not c.replaces for c in found if c.name != "eps")


def test_parameters_with_the_same_effect_are_one(found: list[Candidate]) -> None:
    assert {c.name: c.aliases for c in found if c.aliases} == {"k": ("u_c",)}


def test_a_replaced_term_has_the_index_of_its_parameter(found: list[Candidate]) -> None:
    index = indices_by_name(found)
    assert found[index["u: u**2"]].name == "eps"
    assert found[index["parameter eps"]].name == "eps"
    assert index["lam: u**2"] != index["u: u**2"]
    assert set(index.values()) == set(range(len(found)))


def test_the_forcing_of_a_parameter_is_the_changed_parameter(
    engine: System, found: list[Candidate]
) -> None:
    """For parameters that enter linearly, one in each row."""
    changes = {"eps": 0.05, "nu": 0.02, "s": -0.4, "q": 0.1}
    index = {c.name: j for j, c in enumerate(found)}
    xi = torch.zeros((len(changes), len(found)), dtype=torch.float64)
    for row, (name, change) in enumerate(changes.items()):
        xi[row, index[name]] = change
    start = nominal_start(engine).expand(len(changes), -1, -1)
    runs = simulate(engine, start, TIMES, build_forcing(found, xi))
    for run, (name, change) in zip(runs, changes.items(), strict=True):
        values = engine.config.parameters | {name: engine.config.parameters[name] + change}
        changed = System(replace(engine.config, parameters=values), engine.where)
        torch.testing.assert_close(run, nominal(changed), rtol=1e-10, atol=1e-10)
        assert float((run - nominal(engine)).abs().max()) > 1e-3


def test_every_term_of_a_candidate_has_its_coefficient(
    engine: System, found: list[Candidate]
) -> None:
    nu, cubic = (next(c for c in found if c.name == name) for name in ("nu", "u**3"))
    forcing = build_forcing([cubic, nu], torch.tensor([[2.0, 3.0], [4.0, 5.0]]))
    assert [term.equation for term in forcing.terms] == ["u", "u", "lam"]
    assert forcing.coefficients.tolist() == [[2.0, 3.0, 3.0], [4.0, 5.0, 5.0]]


def test_at_its_scale_a_term_is_as_large_as_its_equation(tmp_path: Path) -> None:
    system = laws.declared(tmp_path, ALONE)
    states = nominal(system)
    own = evaluate_terms(system, [Term("u", system.equations["u"])], states, 0.0)
    found = build_candidates(system, library(system, {"u": ["u", "u**3", "1"]}), states, 0.0)
    assert [candidate.name for candidate in found] == ["c", "u", "u**3", "1"]
    for candidate in found:
        [term] = candidate.terms
        mine = candidate.scale * evaluate_terms(system, [term], states, 0.0)
        assert float(mine.square().mean()) == pytest.approx(float(own.square().mean()))


def test_linear_terms_are_limited_by_their_fastest_mode(tmp_path: Path) -> None:
    system = laws.declared(tmp_path, RING)
    highest, dt = 12 * 0.5, 0.05
    expected = {
        "u: u": 1 / dt,
        "u: v": 1 / dt,
        "u: d(u, x, 2)": 1 / (highest**2 * dt),
        "u: d(u, x, 4)": 1 / (highest**4 * dt),
        "v: d(u, x, 2)": 1 / (highest**2 * dt),
        "u: d(u, x)": math.inf,  # oscillates, does not grow
        "u: d(u, x, 3)": math.inf,
        "u: u**2": math.inf,
        "u: u**3 + d(u, x, 2)": 1 / (highest**2 * dt),
    }
    listed: dict[str, list[str]] = {"u": [], "v": []}
    for name in expected:
        listed[name[0]].append(name[3:])
    found = build_candidates(system, library(system, listed), nominal(system), 0.0)
    limits = {str(candidate): candidate.limit for candidate in found}
    assert limits == pytest.approx(expected)


def test_the_limit_of_a_parameter_is_that_of_its_terms(
    engine: System, found: list[Candidate]
) -> None:
    limits = {c.name: c.limit for c in found if c.equation is None}
    assert limits.pop("nu") == pytest.approx(1 / (24**2 * engine.dt))
    assert set(limits.values()) == {math.inf}


def test_zero_or_non_finite_terms_are_no_candidates(tmp_path: Path) -> None:
    system = laws.declared(tmp_path, RING)
    listed = {"u": ["log(u - 100)", "step(u - 100)", "u**2"]}
    found = build_candidates(system, library(system, listed), nominal(system), 0.0)
    assert [str(candidate) for candidate in found] == ["u: u**2"]


def test_terms_of_a_field_that_the_simulation_holds_constant_are_candidates(
    tmp_path: Path,
) -> None:
    """A simulator of a reaction that knows no reaction."""
    system = laws.declared(tmp_path, STILL)
    still = torch.full((9, 1), 2.0, dtype=torch.float64)
    moved = still + 0.1 * torch.linspace(-1, 1, 9, dtype=torch.float64)[:, None]
    times = torch.linspace(0, 4, 9, dtype=torch.float64)
    listed = library(system, {"a": ["1", "a", "a**2", "abs(a)"]})
    assert [c.name for c in build_candidates(system, listed, still, times)] == ["1"]
    found = build_candidates(system, listed, still, times, moved=moved)
    assert [c.name for c in found] == ["1", "a", "a**2"]
    # The equation is 0: a term has the scale at which a changes by itself in the time of 4.
    assert [c.scale for c in found] == pytest.approx([0.5, 0.25, 0.125])
