"""The law of an assimilation with dynamics is the set of terms with the lowest score."""

from __future__ import annotations

import math

import numpy as np
import pytest
import torch
from torch import Tensor

from callbacks.simplest_law import best_law, simplest_law
from dashred.core.budget import OutOfTimeError
from dashred.core.numerics.block_tridiagonal import Array
from dashred.models.dynamics.dynamic_assimilation import DynamicAssimilation
from dashred.models.dynamics.network_assimilation import LEAST_ERROR
from dashred.models.dynamics.state_fit import Fitted, Minimum, StateFit
from dashred.models.dynamics.unknowns import Unknowns
from tests.callbacks.test_law_selection import COEFFICIENT
from tests.models.dynamics.test_dynamic_assimilation import data, make, real, shred, system

__all__ = ["data", "real", "shred", "system"]

TRUE, INVENTED, TERMS = 1, (4, 6), 8


@pytest.fixture
def module(system, shred, data) -> DynamicAssimilation:
    return make(system, shred, data)


def penalty(count: int) -> float:
    """Half of the gain that a term needs."""
    return math.log(count) + 2 * math.log(TERMS)


def losses_of(monkeypatch, gains: dict[int, float], readings: int):
    """Let each term lower the deviance by a given amount; return the laws that are fitted."""
    tried: list[list[int]] = []

    def fit(self, start: Tensor, error: float) -> Minimum:
        coefficients = self.problem.dynamics.coefficients.detach()
        support = coefficients.nonzero().flatten().tolist()
        tried.append(support)
        gain = sum(gains.get(term, 0.0) for term in support)
        parts = {"train": 9.0 - gain / readings, "step_error": 0.2}
        law = (coefficients != 0).double()
        fitted = Fitted(Unknowns(start, law), law * self.problem.dynamics.scales, parts)
        return Minimum(self, error, fitted)

    def law_equations(self, at: Unknowns, error: float) -> tuple[Array, Array, float]:
        # With little prior, term j lowers the loss by gⱼ².
        lowered = np.sqrt([gains.get(j, 0.0) for j in range(TERMS)])
        return np.eye(TERMS), lowered - at.law.numpy(), 0.0

    monkeypatch.setattr(StateFit, "fit", fit)
    monkeypatch.setattr(StateFit, "law_equations", law_equations)
    return tried


def minimum(module, data, proposed: list[int]) -> Minimum:
    law = torch.zeros(TERMS).double()
    law[proposed] = 0.1
    module.dynamics.set_law(law)
    return module.loss(data.fitted).fit(module.basis.guess.double(), LEAST_ERROR)


def law_of(module, data, proposed: list[int]) -> list[int]:
    found = simplest_law(minimum(module, data, proposed))
    return [int(j) for j in found.fitted.coefficients.nonzero().flatten()]


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


def test_without_a_factor_the_law_of_the_minimum_stays(module, data, monkeypatch):
    losses_of(monkeypatch, {TRUE: 200.0}, data.fitted.numel())
    monkeypatch.setattr(StateFit, "law_equations", lambda *_: None)
    assert law_of(module, data, [2, 3]) == [2, 3]


def test_missing_readings_do_not_count(module, data, monkeypatch):
    data.fitted[5:] = torch.nan
    count = int((~data.fitted.isnan()).sum())
    losses_of(monkeypatch, dict.fromkeys((TRUE, *INVENTED), 2.2 * penalty(count)), count)
    assert law_of(module, data, []) == [TRUE, *INVENTED]


def test_the_missing_term_is_found_from_a_wrong_proposal(module, data):
    found = simplest_law(minimum(module, data, [0])).fitted
    assert found.coefficients.nonzero().flatten().tolist() == [TRUE]
    assert float(found.coefficients[TRUE]) == pytest.approx(COEFFICIENT, rel=0.05)


def test_without_time_the_law_of_the_proposal_stays(module, data, monkeypatch):
    losses_of(monkeypatch, {TRUE: 200.0}, data.fitted.numel())

    def late(*_) -> None:
        raise OutOfTimeError

    monkeypatch.setattr(StateFit, "law_equations", late)
    assert law_of(module, data, [2, 3]) == [2, 3]
    with pytest.raises(OutOfTimeError):
        best_law(minimum(module, data, [2]))
