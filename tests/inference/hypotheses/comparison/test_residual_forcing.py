"""A forcing on the uncorrected simulator is fitted only where a simple law leaves something."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any, NoReturn

import pytest
import torch
from torch import Tensor

from dashred.core.budget import Budget
from dashred.inference.fit.fitted_law import build_law
from dashred.inference.fit.levenberg_marquardt import minimise
from dashred.inference.hypotheses.comparison import compare_hypotheses as module
from dashred.inference.hypotheses.comparison import local_and_extended
from dashred.inference.hypotheses.comparison.comparison import Additions
from dashred.inference.hypotheses.comparison.residual_forcing import (
    MIN_COEFFICIENT_RATIO,
    ResidualForcing,
    add_forcing_alone,
    fit_residual_forcing,
)
from dashred.inference.hypotheses.hypothesis_fit import HypothesisFit
from dashred.inference.hypotheses.result import MIN_FORCING_GAIN
from tests.waves import Waves, fitted

SIGMA = 0.02
TRUTH = {"u: u**2": -0.15, "v: 1": 0.1}


@pytest.fixture(scope="module")
def recorded(waves: Waves) -> Tensor:
    """Readings of the waves with two further terms."""
    return waves.recorded(SIGMA, 1, [(waves.everything[name], xi) for name, xi in TRUTH.items()])


def fit(waves: Waves, recorded: Tensor, names: Sequence[str]) -> HypothesisFit:
    """Return the fit of a law."""
    objective = waves.objective(recorded, SIGMA, names)
    begin = torch.zeros(objective.modes + len(names), dtype=torch.float64)
    begin[: objective.modes] = fitted(waves.objective(recorded, SIGMA))
    found = minimise(objective, begin, 12, 1e-4)
    return HypothesisFit(build_law(objective, found, found.cost), objective, found.phi)


def residual_of(waves: Waves, recorded: Tensor, names: Sequence[str]) -> ResidualForcing:
    """Return what a law with rivals leaves."""
    full = waves.objective(recorded, SIGMA, list(waves.everything))
    best, null = (fit(waves, recorded, each) for each in (names, []))
    return fit_residual_forcing(full, best, null, True, waves.size, lambda *_: None)


def test_no_forcing_alone_beside_a_simple_law_that_explains_all(
    waves: Waves, recorded: Tensor
) -> None:
    found = residual_of(waves, recorded, list(TRUTH))
    assert found.is_unclear and found.forcing_gain < MIN_FORCING_GAIN
    assert found.forcing_alone is None and found.forcing_map is None
    [forcing] = found.forcings
    assert forcing.objective.forward_model.law.count == 2
    assert found.full_problem.noise.std.numpy() == pytest.approx(SIGMA, rel=0.2)
    later = add_forcing_alone(found, waves.size)
    assert later.forcing_alone is not None and later.forcing_map is not None
    assert later.forcing_alone.objective.forward_model.law.count == 0
    assert later.forcings == found.forcings


def test_a_forcing_alone_where_a_law_leaves_something(waves: Waves, recorded: Tensor) -> None:
    found = residual_of(waves, recorded, ["v: u*v"])
    assert found.forcing_gain > MIN_FORCING_GAIN
    assert found.forcing_alone is not None and found.forcing_map is not None
    assert found.forcings[0].objective.forward_model.law.count == 0


@pytest.mark.parametrize(
    ("names", "is_other"), [([*TRUTH, "u: u"], False), (["u: u**2", "u: 1"], True)]
)
def test_a_rival_that_contains_the_law_is_no_other_explanation(
    waves: Waves,
    recorded: Tensor,
    monkeypatch: pytest.MonkeyPatch,
    names: list[str],
    is_other: bool,
) -> None:
    class SeenError(Exception):
        """Carries what the comparison says of the rivals."""

    def end(*arguments: Any) -> NoReturn:
        raise SeenError(arguments[3])

    monkeypatch.setattr(module, "fit_residual_forcing", end)
    full = waves.objective(recorded, SIGMA, list(waves.everything))
    best, null, rival = (fit(waves, recorded, each) for each in (list(TRUTH), [], names))
    additions = Additions(len(waves.everything), waves.size, lambda: waves.simulator, list)
    with pytest.raises(SeenError) as seen:
        module.compare_hypotheses(full, best, null, [rival], additions, Budget(), lambda *_: None)
    assert seen.value.args == (is_other,)


@pytest.mark.parametrize("factor", [0.9, 1.1])
def test_windows_are_not_searched_beside_certain_coefficients(
    waves: Waves, recorded: Tensor, monkeypatch: pytest.MonkeyPatch, factor: float
) -> None:
    searched: list[str] = []

    def note(kind: str) -> Any:
        def fit(*_: Any) -> list[HypothesisFit]:
            searched.append(kind)
            return []

        return fit

    monkeypatch.setattr(local_and_extended, "fit_windowed_laws", note("windows"))
    monkeypatch.setattr(local_and_extended, "fit_extended_laws", note("extended"))
    residual = residual_of(waves, recorded, list(TRUTH))
    law = residual.best.law
    std = law.coefficients.abs() / (factor * MIN_COEFFICIENT_RATIO)
    best = replace(residual.best, law=replace(law, covariance=torch.diag(std**2)))
    additions = Additions(len(waves.everything), waves.size, lambda: waves.simulator, list)
    assert local_and_extended.fit_single_terms(replace(residual, best=best), additions) == []
    assert searched == (["extended"] if factor > 1 else ["extended", "windows"])
