"""Screening finds the term, whatever law or forcing has fitted the trajectory."""

from __future__ import annotations

import math

import pytest
import torch

from dashred.inference.fit.fitted_law import build_law
from dashred.inference.fit.least_squares import LeastSquaresProblem
from dashred.inference.fit.levenberg_marquardt import minimise
from dashred.inference.forward.law_block import restrict_to_window
from dashred.inference.hypotheses.comparison.repeated_screening import repeat_screening
from dashred.inference.hypotheses.comparison.residual_forcing import fit_residual_forcing
from dashred.inference.hypotheses.extended.extended_library import fit_extended_laws
from dashred.inference.hypotheses.free_forcing import FreeForcing, fit_free_forcing
from dashred.inference.hypotheses.hypothesis_fit import HypothesisFit
from dashred.inference.hypotheses.windows.screening import profile_out, screen
from dashred.inference.hypotheses.windows.windowed_hypothesis import (
    Hypothesis,
    WindowGuess,
    build_problem,
    first_unknowns,
)
from dashred.inference.hypotheses.windows.windowed_laws import fit_windowed_laws
from dashred.physics.window import box, gate
from tests.waves import Waves, fitted

SIGMA = 0.02


def force_law(waves: Waves, recorded: torch.Tensor, names: list[str]) -> FreeForcing:
    """Return a free forcing on top of a law that was fitted."""
    law = waves.objective(recorded, SIGMA, names)
    begin = torch.zeros(law.modes + len(names), dtype=torch.float64)
    begin[: law.modes] = fitted(waves.objective(recorded, SIGMA))
    found = minimise(law, begin, 10, 1e-4)
    return fit_free_forcing(law, found.phi, waves.size)[0]


def everything(waves: Waves, recorded: torch.Tensor) -> LeastSquaresProblem:
    return waves.objective(recorded, SIGMA, list(waves.everything))


@pytest.mark.parametrize("names", [[], ["u: u**2"], ["u: u", "v: 1"]])
def test_a_term_is_found_whatever_law_is_under_the_forcing(waves: Waves, names: list[str]) -> None:
    recorded = waves.recorded(SIGMA, 1, [(waves.everything["u: u**2"], -0.15)])
    objective = everything(waves, recorded)
    forced = force_law(waves, recorded, names)
    columns = objective.forward_model.law.candidates
    problem = profile_out(objective, forced, columns, objective.prior_std)
    costs = problem.costs([(j,) for j in range(len(columns))])
    best = int(costs.argmin())
    assert str(columns[best]) == "u: u**2"
    # The law under the forcing is removed before the columns are fitted.
    assert problem.constant - float(costs[best]) > 100
    assert float(problem.coefficients((best,))[0]) == pytest.approx(-0.15, rel=0.1)


def in_a_box(waves: Waves, recorded: torch.Tensor, name: str) -> HypothesisFit:
    """Return the fit of a term in a box whose first guess is slightly off."""
    law = waves.objective(recorded, SIGMA, [name])
    guess = WindowGuess(box(waves.system.axes[0]), (4.0, 2.0, math.log(0.4)), (2.5, 1.25, 1.0))
    problem = build_problem(law, Hypothesis((), (0,), guess))
    z = fitted(waves.objective(recorded, SIGMA))
    found = minimise(problem, first_unknowns(z, [0.0], guess), 12, 1e-4)
    return HypothesisFit(build_law(problem, found, found.cost), problem, found.phi)


def test_a_law_in_a_window_may_be_under_the_forcing(waves: Waves) -> None:
    window = box(waves.system.axes[0]).at([4.4, 1.8, math.log(0.3)])
    hidden = restrict_to_window(waves.candidates(["u: u**3"]), window)
    recorded = waves.recorded(SIGMA, 1, [(hidden[0], -0.3)])
    wrong = in_a_box(waves, recorded, "u: u")
    forced, gain = fit_free_forcing(wrong.objective, wrong.phi, waves.size)
    assert gain > 4
    objective = everything(waves, recorded)
    forms = restrict_to_window(list(waves.everything.values()), window)
    problem = profile_out(objective, forced, forms, objective.prior_std)
    costs = problem.costs([(j,) for j in range(len(forms))])
    best = int(costs.argmin())
    assert forms[best].key == "u: u**3"
    assert float(problem.coefficients((best,))[0]) == pytest.approx(-0.3, rel=0.1)
    # The linearised problem predicts the F of a fit.
    assert float(costs[best]) == pytest.approx(objective.noise.count, rel=0.3)


@pytest.mark.slow
def test_screening_is_repeated_while_a_forcing_gains(waves: Waves) -> None:
    edges = [4.4, 1.8, math.log(0.3)]
    hidden = restrict_to_window(waves.candidates(["u: u**3"]), box(waves.system.axes[0]).at(edges))
    recorded = waves.recorded(SIGMA, 1, [(hidden[0], -0.3)])
    wrong = in_a_box(waves, recorded, "u: u")
    whole, count = everything(waves, recorded), len(waves.everything)
    begin, _ = fit_free_forcing(wrong.objective, wrong.phi, waves.size)
    calls: list[float] = []

    def screened(forced: FreeForcing, bound: float) -> list[HypothesisFit]:
        calls.append(bound)
        if len(calls) == 1:
            return [wrong]
        return fit_windowed_laws(whole, count, range(count), forced, math.inf, bound)

    found, best, nearest, gain = repeat_screening(wrong, screened, [begin], 9.0, waves.size, silent)
    assert calls[:2] == [math.inf, wrong.law.score]
    [candidate] = best.law.candidates
    assert candidate.key == "u: u**3" and candidate.window is not None
    assert found[0] is wrong and best.law.score < wrong.law.score - 6
    assert gain < 4 and nearest.cost <= begin.cost


def test_screening_ends_if_nothing_better_is_found(waves: Waves) -> None:
    window = box(waves.system.axes[0]).at([4.4, 1.8, math.log(0.3)])
    hidden = restrict_to_window(waves.candidates(["u: u**3"]), window)
    wrong = in_a_box(waves, waves.recorded(SIGMA, 1, [(hidden[0], -0.3)]), "u: u")
    begin, _ = fit_free_forcing(wrong.objective, wrong.phi, waves.size)
    calls: list[float] = []

    def screened(forced: FreeForcing, bound: float) -> list[HypothesisFit]:
        calls.append(bound)
        return []

    found, best, _, gain = repeat_screening(wrong, screened, [begin], 9.0, waves.size, silent)
    assert (found, best, calls) == ([], wrong, [math.inf, wrong.law.score])
    assert gain > 4


@pytest.mark.parametrize("better", [True, False])
def test_the_next_trajectory_is_used_if_one_leads_to_nothing(waves: Waves, better: bool) -> None:
    recorded = waves.recorded(SIGMA, 1, [(waves.everything["u: u**2"], -0.15)])
    alone, on_law = force_law(waves, recorded, []), force_law(waves, recorded, ["u: u"])
    wrong, right = everywhere(waves, recorded, "u: u"), everywhere(waves, recorded, "u: u**2")
    calls: list[FreeForcing] = []

    def screened(forced: FreeForcing, bound: float) -> list[HypothesisFit]:
        calls.append(forced)
        return [right] if forced is on_law or better else []

    _, best, *_ = repeat_screening(wrong, screened, [alone, on_law], 9.0, waves.size, silent)
    assert best is right
    assert calls == ([alone] if better else [alone, on_law])


def everywhere(waves: Waves, recorded: torch.Tensor, *names: str) -> HypothesisFit:
    """Return the fit of a law that acts everywhere."""
    law = waves.objective(recorded, SIGMA, names)
    z = fitted(waves.objective(recorded, SIGMA))
    found = minimise(law, torch.cat([z, torch.zeros(len(names), dtype=torch.float64)]), 10, 1e-4)
    return HypothesisFit(build_law(law, found, found.cost), law, found.phi)


@pytest.mark.parametrize(
    ("names", "expected"),
    [(["u: u**2"], ["u: u**2"]), (["u: u"], [""]), (["u: u", "u: u**2", "v: 1"], ["", "all"])],
)
def test_a_law_of_many_terms_is_not_the_only_trajectory(
    waves: Waves, names: list[str], expected: list[str]
) -> None:
    recorded = waves.recorded(SIGMA, 1, [(waves.everything["u: u**2"], -0.15)])
    best, null = everywhere(waves, recorded, *names), everywhere(waves, recorded)
    whole = everything(waves, recorded)
    left = fit_residual_forcing(whole, best, null, True, waves.size, silent)
    laws = [[str(c) for c in each.objective.forward_model.law.candidates] for each in left.forcings]
    names_of = {"": [], "all": names}
    assert laws == [names_of.get(each, [each]) for each in expected]
    assert left.best_forcing is min(left.forcings, key=lambda each: each.cost)


def silent(share: float, message: str) -> None:
    """Report nothing."""


def test_a_gate_between_two_thresholds_is_screened_at_its_place(waves: Waves) -> None:
    term, edges = waves.everything["u: v**2"], [0.2, math.log(0.1)]
    recorded = waves.recorded(
        SIGMA, 1, [(restrict_to_window([term], gate("u", 1).at(edges))[0], -0.4)]
    )
    forced = force_law(waves, recorded, [])
    forward_model = forced.objective.forward_model
    states = forward_model.sampled_states(*forced.objective.split(forced.phi))
    count = len(waves.everything)
    found = screen(everything(waves, recorded), count, range(count), forced, states)
    gates = [f for f in found if f.hypothesis.guess and f.hypothesis.guess.shape == gate("u", 1)]
    best = min(gates, key=lambda f: f.cost).hypothesis
    assert best.guess is not None
    assert [str(list(waves.everything.values())[j]) for j in best.windowed_terms] == ["u: v**2"]
    assert abs(best.guess.values[0] - 0.2) < 0.1 * float(states[:, 0].max() - states[:, 0].min())


def test_a_gate_that_acts_in_few_samples_is_screened_at_its_place(waves: Waves) -> None:
    states = waves.simulated()
    low = float(states[:, 0].quantile(0.01))
    term = waves.everything["u: 1"]
    window = gate("u", -1).at([low, math.log(0.02)])
    recorded = waves.recorded(SIGMA, 1, [(restrict_to_window([term], window)[0], 1.5)])
    forced = force_law(waves, recorded, [])
    count = len(waves.everything)
    found = screen(everything(waves, recorded), count, range(count), forced, states)
    best = min(found, key=lambda f: f.cost).hypothesis
    assert best.guess is not None and best.guess.shape.kind == "gate below"
    assert best.guess.values[0] < float(states[:, 0].quantile(0.05))


@pytest.mark.slow
def test_a_term_beyond_the_library_is_found_about_a_library_law(waves: Waves) -> None:
    hidden = {str(candidate): candidate for candidate in waves.extended}["u: sin(2*u)"]
    recorded = waves.recorded(SIGMA, 1, [(hidden, 0.3)])
    forced = force_law(waves, recorded, ["u: u", "u: u**2"])
    inside = everything(waves, recorded)
    found = fit_extended_laws(inside, waves.extended, forced, len(waves.everything))
    best = min(found, key=lambda fit: fit.law.score).law
    assert [candidate.key for candidate in best.candidates] == ["u: sin(2*u)"]
    assert float(best.coefficients[0]) == pytest.approx(0.3, rel=0.15)
