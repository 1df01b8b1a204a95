"""The law of an assimilation with dynamics is the set of terms with the lowest score."""

from __future__ import annotations

import math

import numpy as np
import pytest
import torch
from torch import Tensor

from callbacks.simplest_law import simplest_law
from dashred.core.budget import OutOfTimeError
from dashred.core.numerics.block_tridiagonal import Array
from dashred.models.dynamics.dynamic_assimilation import DynamicAssimilation
from dashred.models.dynamics.state_fit import Fitted, StateFit
from dashred.models.dynamics.weak_constraint import Unknowns
from tests.callbacks.test_law_regression import COEFFICIENT, module
from tests.models.dynamics.test_dynamic_assimilation import data, real, shred, system

__all__ = ["data", "module", "real", "shred", "system"]

TRUE, INVENTED, TERMS = 1, (4, 6), 8


def penalty(count: int) -> float:
    """Half of the gain that a term needs."""
    return math.log(count) + 2 * math.log(TERMS)


def losses_of(monkeypatch, gains: dict[int, float], readings: int, step_error: float = 0.2):
    """Let each term lower the deviance by a given amount; return the laws that are fitted."""
    tried: list[list[int]] = []

    def refit(
        self, batch: tuple[Tensor, Tensor], coefficients: Tensor, start: Tensor | None = None
    ) -> Fitted:
        support = coefficients.nonzero().flatten().tolist()
        tried.append(support)
        with torch.no_grad():
            self.dynamics.law.add_(1.0)
        gain = sum(gains.get(term, 0.0) for term in support)
        parts = {"train": 9.0 - gain / readings, "step_error": step_error}
        law = (coefficients != 0).double()
        return Fitted(Unknowns(torch.zeros(2, 3), law), law * self.dynamics.scales, parts)

    def law_equations(self, at: Unknowns, error: float) -> tuple[Array, Array, float]:
        # With little prior, term j lowers the loss by gⱼ².
        lowered = np.sqrt([gains.get(j, 0.0) for j in range(TERMS)])
        return np.eye(TERMS), lowered - at.law.numpy(), 0.0

    monkeypatch.setattr(DynamicAssimilation, "refit", refit)
    monkeypatch.setattr(StateFit, "law_equations", law_equations)
    return tried


def law_of(module, data, proposed: list[int]) -> list[int]:
    before = {name: value.clone() for name, value in module.state_dict().items()}
    coefficients = np.zeros(TERMS)
    coefficients[proposed] = 0.1
    found, fitted = simplest_law(module, (data.windows, data.fitted), coefficients)
    assert all(torch.equal(value, before[name]) for name, value in module.state_dict().items())
    assert fitted is None or found.tolist() == fitted.coefficients.tolist()
    return [int(j) for j in found.nonzero()[0]]


@pytest.mark.parametrize("proposed", [[TRUE], [], [3], [TRUE, *INVENTED]])
def test_any_proposal_leads_to_the_terms_that_pay_for_themselves(
    module, data, monkeypatch, proposed
):
    count = data.fitted.numel()
    gains = {TRUE: 200.0, **dict.fromkeys(INVENTED, 1.8 * penalty(count))}
    tried = losses_of(monkeypatch, gains, count)
    assert law_of(module, data, proposed) == [TRUE]
    assert tried == [proposed, [TRUE]][: 1 + (proposed != [TRUE])]


def test_all_terms_that_pay_for_themselves_are_taken(module, data, monkeypatch):
    count = data.fitted.numel()
    gains = {TRUE: 200.0, **dict.fromkeys(INVENTED, 2.2 * penalty(count))}
    losses_of(monkeypatch, gains, count)
    assert law_of(module, data, [TRUE]) == [TRUE, *INVENTED]


def test_nothing_is_left_where_no_term_is_needed(module, data, monkeypatch):
    losses_of(monkeypatch, {}, data.fitted.numel())
    assert law_of(module, data, [TRUE, *INVENTED]) == []


def test_steps_that_do_not_fit_decide_nothing(module, data, monkeypatch):
    losses_of(monkeypatch, {TRUE: 200.0}, data.fitted.numel(), step_error=1.5)
    assert law_of(module, data, [2, 3]) == [2, 3]


def test_without_a_factor_the_law_of_the_proposal_stays(module, data, monkeypatch):
    losses_of(monkeypatch, {TRUE: 200.0}, data.fitted.numel())
    monkeypatch.setattr(StateFit, "law_equations", lambda *_: None)
    assert law_of(module, data, [2, 3]) == [2, 3]


def test_missing_readings_do_not_count(module, data, monkeypatch):
    data.fitted[5:] = torch.nan
    count = int((~data.fitted.isnan()).sum())
    losses_of(monkeypatch, dict.fromkeys((TRUE, *INVENTED), 2.2 * penalty(count)), count)
    assert law_of(module, data, []) == [TRUE, *INVENTED]


def test_the_missing_term_is_found_from_a_wrong_proposal(module, data):
    wrong = np.zeros(TERMS)
    wrong[0] = 0.01
    found, fitted = simplest_law(module, (data.windows, data.fitted), wrong)
    assert fitted is not None and found.nonzero()[0].tolist() == [TRUE]
    assert found[TRUE] == pytest.approx(COEFFICIENT, rel=0.05)


def test_without_time_the_law_of_the_proposal_stays(module, data, monkeypatch):
    losses_of(monkeypatch, {TRUE: 200.0}, data.fitted.numel())

    def late(*_) -> None:
        raise OutOfTimeError

    monkeypatch.setattr(StateFit, "law_equations", late)
    assert law_of(module, data, [2, 3]) == [2, 3]
