"""Assimilation with dynamics in the pipeline: the field, the law, the log, and what is refused."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest
import torch

from dashred.config import load_config
from dashred.core.budget import Budget
from dashred.core.errors import InputError
from dashred.core.mlflow.metric_names import metric_name
from dashred.physics.solvers.simulate import simulate
from dashred.physics.system import System
from dashred.pipeline.input.build_problem import build_problem
from dashred.pipeline.networks.assimilation_plan import DYNAMIC_EPOCHS
from tests.pipeline.networks.conftest import Configured
from tests.pipeline.networks.fits import Networks, fit_networks

WORDS = ("assimilation.dynamics=true", "assimilation.gain=0.99")


@pytest.fixture(scope="module")
def found(configured: Configured) -> Networks:
    return fit_networks(configured(*WORDS))


def field_errors(case: Path, configured: Configured, found: Networks) -> tuple[float, float]:
    """Return the errors of SHRED and DA-SHRED in the real field."""
    config = load_config([f"conf={case.parent / 'truth.yaml'}"], entry="test")
    system = System(config.system, config.where)
    first = 1 + 0.5 * torch.cos(system.grid.coordinates["x"])
    fit = configured().problem.split.fit
    real = simulate(system, first[None, None], torch.from_numpy(fit.times))[0]
    before, after = (
        float((states - real).square().mean().sqrt())
        for states in (found.assimilated.shred, found.assimilated.dashred)
    )
    return before, after


def test_the_errors_of_every_part_and_the_law_are_logged(
    configured: Configured, found: Networks
) -> None:
    curves = found.assimilated.curves
    epochs = found.assimilated.epochs[:-1]
    for part in ("train", "misfit", "forecast_misfit", "step_error", "background", "law"):
        assert [epoch for epoch, _ in curves[f"loss/{part}"]] == epochs
    assert [epoch for epoch, _ in curves["loss/network_error"]] == epochs[1:]
    assert len(found.assimilated.epochs) <= DYNAMIC_EPOCHS + 1
    history = found.assimilated.coefficients["dynamics"]
    assert len(history) == len(found.assimilated.epochs)
    assert history[-1] == found.assimilated.proposals["dynamics"].coefficients.tolist()
    logged = {(step, key): value for step, point in found.log for key, value in point.items()}
    for epoch, row in zip(found.assimilated.epochs, history, strict=True):
        for term, value in zip(configured().problem.library, row, strict=True):
            if value != 0:
                assert logged[epoch, metric_name("dynamics", term.equation, str(term))] == value


def test_the_missing_term_is_found_by_the_network_alone(
    configured: Configured, found: Networks
) -> None:
    law = found.assimilated.proposals["dynamics"].coefficients
    names = [str(term) for term in configured().problem.library]
    assert [name for name, value in zip(names, law, strict=True) if value] == ["u"]
    assert law[names.index("u")] == pytest.approx(-0.1, rel=0.1)


def test_the_field_is_much_nearer_to_the_real_one(
    case: Path, configured: Configured, found: Networks
) -> None:
    before, after = field_errors(case, configured, found)
    assert after < 0.5 * before


@pytest.mark.parametrize("residual", ["alg1", "alg2"])
def test_steps_may_be_compared_in_latent_space(
    case: Path, configured: Configured, residual: str
) -> None:
    found = fit_networks(configured(*WORDS, f"assimilation.residual={residual}"))
    fitted, curves = found.assimilated, found.assimilated.curves
    assert set(fitted.proposals) == {"alg1", "alg2"} and not fitted.parameters
    assert len(curves["loss/step_error"]) == len(fitted.epochs) - 1 > 1
    before, after = field_errors(case, configured, found)
    assert after < 0.9 * before


def test_the_same_seed_gives_the_same_result(configured: Configured, found: Networks) -> None:
    again = fit_networks(configured(*WORDS))
    assert torch.equal(again.assimilated.dashred, found.assimilated.dashred)
    assert again.assimilated.coefficients == found.assimilated.coefficients


def test_a_spent_budget_ends_it_after_an_epoch(configured: Configured) -> None:
    simulated = configured(*WORDS)
    spent = replace(simulated, problem=replace(simulated.problem, budget=Budget.begin(1e-9)))
    ended = fit_networks(spent).assimilated
    assert ended.epochs == [1, 2]
    assert any("of the assimilation" in what for what in spent.problem.budget.not_tried)


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("assimilation.encoder_rate=1e-3",), "freezes SHRED's LSTM"),
        (
            ("system.axes.x.ends={left: {value: 1}, right: {slope: 0}}",),
            "needs equations with a fixed explicit step",
        ),
    ],
)
def test_what_cannot_be_is_refused(case: Path, words: tuple[str, ...], message: str) -> None:
    config = load_config([f"conf={case}", WORDS[0], *words], entry="test")
    with pytest.raises(InputError, match=message) as error:
        build_problem(config)
    assert error.value.hint
