"""The observer in a run: every episode, without faulty sensors, and without programs."""

from __future__ import annotations

import json
from types import SimpleNamespace
from typing import Any

import pytest
import torch

from dashred.inference.fit.law import FittedParameter, Law
from dashred.inference.forward.candidates import Candidate
from dashred.physics.expressions.nodes import Name
from dashred.physics.system import Term
from dashred.pipeline import observer

ANY: Any = None
DECAY = Candidate("x", "x", (Term("x", Name("x")),), 1.0)
RATE = Candidate("k", None, (Term("x", Name("y")), Term("y", Name("y"))), 1.0)


def law_of(**parts: Any) -> Law:
    known: dict[str, Any] = {
        "candidates": (DECAY,),
        "coefficients": torch.tensor([0.5]).double(),
        "covariance": torch.tensor([[0.04]]).double(),
        "start": torch.zeros(1, 2),
        "score": 0.0,
        "chi2": 1.0,
        "residuals": torch.zeros(1, 1),
    }
    return Law(**(known | parts))


def test_the_simulations_differ_by_the_covariance_of_the_law_and_of_parameters() -> None:
    law = law_of(parameters=(FittedParameter(RATE, change=0.1, std=0.3),))
    uncertain = observer._uncertainty(law)
    assert uncertain is not None
    assert [str(term) for term in uncertain.terms] == ["y", "y", "x"]
    assert [term.equation for term in uncertain.terms] == ["x", "y", "x"]
    assert list(uncertain.coefficient_of) == [0, 0, 1]
    expected = torch.tensor([[0.09, 0.0], [0.0, 0.04]], dtype=torch.float64)
    torch.testing.assert_close(uncertain.covariance, expected)


def test_the_empty_law_is_certain() -> None:
    none = torch.zeros(0).double()
    empty = law_of(candidates=(), coefficients=none, covariance=torch.zeros(0, 0).double())
    assert observer._uncertainty(empty) is None


def test_a_program_has_no_observer() -> None:
    problem: Any = SimpleNamespace(system=SimpleNamespace(program=object()))
    assert observer.observe_episodes(problem, ANY, ANY, ANY, {}) == []


@pytest.mark.parametrize("name", ["observer", "corrected_shred"])
def test_the_estimators_of_a_twin_are_scored(twin_run: Any, name: str) -> None:
    assert json.loads(twin_run.read("score.json"))["field_rmse"][name] > 0
