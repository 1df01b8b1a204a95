"""Terms that an assimilation with dynamics can do without are left out."""

from __future__ import annotations

import math

import numpy as np
import torch
from torch import Tensor

from callbacks.simplest_law import simplest_law
from dashred.models.dynamics.dynamic_assimilation import DynamicAssimilation, Fitted
from dashred.models.dynamics.weak_constraint import Unknowns
from tests.callbacks.test_law_regression import callback, module, points
from tests.models.dynamics.test_dynamic_assimilation import data, real, shred, system

__all__ = ["callback", "data", "module", "points", "real", "shred", "system"]

TRUE, INVENTED = 1, (4, 6)
PROPOSED = np.array([0, -0.3, 0, 0, 0.02, 0, 0.02, 0])


def losses_of(monkeypatch, by_term: dict[int, float], readings: int, step_error: float = 0.2):
    """Let each term lower the deviance by a given amount; return the laws that are fitted."""
    tried: list[list[int]] = []

    def refit(
        self,
        batch: tuple[Tensor, Tensor],
        coefficients: Tensor,
        start: Unknowns | None = None,
    ) -> Fitted:
        support = coefficients.nonzero().flatten().tolist()
        tried.append(support)
        with torch.no_grad():
            self.dynamics.law.add_(1.0)
        gain = sum(by_term.get(term, 0.0) for term in support)
        parts = {"train": 9.0 - gain / readings, "step_error": step_error}
        unknowns = Unknowns(torch.zeros(2, 3), coefficients[support])
        return Fitted(unknowns, 2 * coefficients, parts)

    monkeypatch.setattr(DynamicAssimilation, "refit", refit)
    return tried


def reduced(module, data, callback, proposed=PROPOSED):
    blocks = callback._blocks(module)
    before = {name: value.clone() for name, value in module.state_dict().items()}
    found, fitted = simplest_law(module, (data.windows, data.fitted), blocks, proposed)
    assert fitted is None or found.tolist() == fitted.coefficients.tolist()
    assert all(torch.equal(value, before[name]) for name, value in module.state_dict().items())
    return found.nonzero()[0].tolist()


def test_terms_that_do_not_pay_for_themselves_are_left_out(module, data, callback, monkeypatch):
    count = data.fitted.numel()
    gains = {TRUE: 80.0, **dict.fromkeys(INVENTED, 0.9 * math.log(count))}
    tried = losses_of(monkeypatch, gains, count)
    assert reduced(module, data, callback) == [TRUE]
    assert tried[:2] == [[1, 4, 6], []]


def test_terms_that_pay_for_themselves_are_kept(module, data, callback, monkeypatch):
    count = data.fitted.numel()
    gains = {TRUE: 80.0, **dict.fromkeys(INVENTED, 1.1 * math.log(count))}
    losses_of(monkeypatch, gains, count)
    assert reduced(module, data, callback) == [1, 4, 6]


def test_nothing_is_left_where_no_term_is_needed(module, data, callback, monkeypatch):
    tried = losses_of(monkeypatch, {}, data.fitted.numel())
    assert reduced(module, data, callback) == []
    assert len(tried) == 2


def test_steps_that_do_not_fit_decide_nothing(module, data, callback, monkeypatch):
    tried = losses_of(monkeypatch, {}, data.fitted.numel(), step_error=1.5)
    assert reduced(module, data, callback) == [1, 4, 6]
    assert len(tried) == 1


def test_missing_readings_do_not_count(module, data, callback, monkeypatch):
    data.fitted[5:] = torch.nan
    count = int((~data.fitted.isnan()).sum())
    losses_of(monkeypatch, dict.fromkeys((TRUE, *INVENTED), 1.1 * math.log(count)), count)
    assert reduced(module, data, callback) == [1, 4, 6]


def test_an_empty_proposal_is_fitted_once(module, data, callback, monkeypatch):
    tried = losses_of(monkeypatch, {}, 1)
    assert reduced(module, data, callback, np.zeros(8)) == []
    assert tried == [[]]
