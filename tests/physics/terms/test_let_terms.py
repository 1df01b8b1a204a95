"""Candidate terms of lets: one change of a let acts in every equation that reads it."""

from __future__ import annotations

from pathlib import Path

import pytest
import torch

from dashred.core.errors import InputError
from dashred.inference.forward.candidates import build_candidates
from dashred.inference.results.corrected_system import build_corrected_system
from dashred.physics.system import System, Term
from dashred.physics.terms.let_terms import (
    build_let_terms,
    equations_with_let,
    is_exact_change,
    let_tangents,
)
from dashred.physics.terms.library import build_library, evaluate_terms
from dashred.reporting.wording.term_description import describe_term
from tests import laws

TEXT = """
system:
  title: cells in a batch
  fields: {X: cells, G: glucose, W: waste}
  parameters: {mu: 0.05, K: 1.2, Y: 0.12, a: 0.3}
  let: {m: mu*G/(K + G), twice: 2*m, lost: a*X}
  equations:
    X: m*X - lost
    G: -m/Y*X
    W: twice*X + 0.01*G
  start: {X: 0.4, G: 20, W: 2}
  spread: {X: 0.1, G: 1, W: 0.5}
  integrator: {dt: 0.5}
recording: {twin: a, sensors: 3, noise: 0, duration: 4, every: 0.5}
"""
FIELD = """
system:
  title: heat
  axes: {x: {length: 2*pi, points: 16}}
  fields: {u: temperature}
  parameters: {k: 0.1}
  let: {D: k*(1 + sin(x)/2)}
  equations: {u: "d(D*d(u, x), x)"}
  start: {u: sin(x)}
  integrator: {dt: 0.05}
recording: {twin: a, sensors: 4, noise: 0, duration: 4, every: 0.5}
"""
STATES = torch.tensor([[0.4, 20.0, 2.0], [1.0, 12.0, 5.0], [2.0, 4.0, 9.0]], dtype=torch.float64)


@pytest.fixture
def system(tmp_path: Path) -> System:
    return laws.declared(tmp_path, TEXT)


def rates(system: System) -> torch.Tensor:
    own = [Term(field, system.equations[field]) for field in system.fields]
    return evaluate_terms(system, own, STATES, 0.0)


def corrected(system: System, let: str, text: str, xi: float) -> System:
    """Return the system corrected by one candidate of a let."""
    terms = build_let_terms(system, {let: [text]})
    [found] = [
        c for c in build_candidates(system, [], STATES, 0.0, let_terms=terms) if c.equation == let
    ]
    law = laws.law([found], [xi])
    return build_corrected_system(system, law)


def test_tangents_follow_a_let_through_other_lets(system: System) -> None:
    [term] = build_let_terms(system, {"m": ["W"]})
    tangents = let_tangents(system, term)
    assert {name: str(Term(name, tangent)) for name, tangent in tangents.items()} == {
        "X": "W*X",
        "G": "-W*X*Y**(-1)",
        "W": "2*W*X",
    }
    assert equations_with_let(system, "lost") == ["X"]


def test_a_let_within_a_derivative_in_space_keeps_its_place(tmp_path: Path) -> None:
    system = laws.declared(tmp_path, FIELD)
    [term] = build_let_terms(system, {"D": ["u"]})
    changed = let_tangents(system, term)
    assert changed == {"u": system.parse("d(u*d(u, x), x)", "test")}
    assert is_exact_change(system, term)
    # Only an ODE system has default terms of lets.
    assert not build_let_terms(system, None)


@pytest.mark.parametrize("use", ["step(m - 1)", "m**2", "where(m > 0, 1, 2)", "exp(m)"])
def test_a_change_is_exact_only_if_the_equations_are_affine(tmp_path: Path, use: str) -> None:
    system = laws.declared(tmp_path, TEXT.replace("X: m*X - lost", f"X: m*X + {use}"))
    assert not is_exact_change(system, Term("m", system.parse("W", "test")))


def test_only_shared_lets_have_default_terms(system: System) -> None:
    found = build_let_terms(system, None)
    assert {term.equation for term in found} == {"m"}
    names = [str(term) for term in found]
    assert names == ["1", "m", "X", "G", "W", "X*m", "G*m", "W*m", "m*X**2", "m*G**2", "m*W**2"]


def test_a_listed_library_has_no_other_terms_of_lets(system: System) -> None:
    assert not build_let_terms(system, {"X": ["X"]})
    assert [str(t) for t in build_let_terms(system, {"lost": ["X**2"]})] == ["X**2"]
    # The equations keep their default terms if only lets are listed.
    assert build_library(system, {"lost": ["X**2"]}) == build_library(system, None)


def test_the_candidate_adds_the_tangent_in_each_equation(system: System) -> None:
    changed = corrected(system, "m", "m*W", -0.02)
    growth = 0.05 * STATES[:, 1] / (1.2 + STATES[:, 1])
    added = -0.02 * growth * STATES[:, 2] * STATES[:, 0]
    expected = torch.stack([added, -added / 0.12, 2 * added])
    assert torch.allclose(rates(changed) - rates(system), expected, rtol=1e-12)


def test_the_corrected_let_contains_the_change_once(system: System) -> None:
    changed = corrected(system, "m", "m*W", -0.02)
    assert changed.config.equations == system.config.equations
    assert changed.config.let["twice"] == "2*m"
    assert changed.config.let["m"] == "mu*G/(K + G) + (-0.02*G*W*mu*(G + K)**(-1))"


def test_a_let_that_acts_nonlinearly_leaves_its_tangents(tmp_path: Path) -> None:
    text = TEXT.replace("lost: a*X", "lost: a*X/(1 + m)")
    system = laws.declared(tmp_path, text)
    assert not is_exact_change(system, Term("m", system.parse("W", "test")))
    changed = corrected(system, "m", "W", 0.01)
    assert changed.config.let == system.config.let
    growth = 0.05 * STATES[:, 1] / (1.2 + STATES[:, 1])
    slope = STATES[:, 0] + 0.3 * STATES[:, 0] / (1 + growth) ** 2
    added = (rates(changed) - rates(system))[0]
    assert torch.allclose(added, 0.01 * STATES[:, 2] * slope, rtol=1e-12)


def test_a_term_of_one_equation_is_not_told_as_a_change_of_a_let(system: System) -> None:
    terms = build_let_terms(system, {"lost": ["X"]})
    found = build_candidates(
        system, build_library(system, {"X": ["X"]}), STATES, 0.0, let_terms=terms
    )
    assert [str(c) for c in found if c.equation == "lost"] == []


def test_the_unit_is_that_of_the_let(tmp_path: Path) -> None:
    text = TEXT.replace("fields: {X: cells, G: glucose, W: waste}", FIELDS)
    system = laws.declared(tmp_path, text)
    terms = build_let_terms(system, {"m": ["m*W"]})
    described = describe_term(system, "m", terms[0].expression, -0.02, 0.001)
    assert described.text == (
        "a change of m in the equations of X, G and W by (−0.0200 ± 0.0020 l/g)·W·m"
    )


FIELDS = "fields: {X: 'cells [g/l]', G: 'glucose [g/l]', W: 'waste [g/l]'}"


@pytest.mark.parametrize(
    ("let", "library", "message"),
    [
        ("lost: a*X", "{m: [twice]}", "reads 'twice', which is defined after it"),
        ("lost: a*X, idle: 3", "{idle: [X]}", "no equation reads let 'idle'"),
        ("lost: a*X", "{n: [X]}", "neither a field nor a let"),
        ("lost: a*X", "{m: [Q]}", "'Q'"),
    ],
)
def test_wrong_terms_of_lets_are_told(tmp_path: Path, let: str, library: str, message: str) -> None:
    text = TEXT.replace("lost: a*X", let) + f"library: {library}\n"
    with pytest.raises(InputError) as problem:
        laws.declared(tmp_path, text)
    assert message in str(problem.value)
