"""Screening asks every term anew, whatever has brought the trajectory to the recording."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest
import torch

from dashred.discovery.beyond import laws_beyond
from dashred.discovery.free_forcing import FreeForcing, force
from dashred.discovery.gauss_newton import minimise
from dashred.discovery.local_shooting import localised
from dashred.discovery.objective import Objective
from dashred.discovery.screening import eliminated, screen
from dashred.physics.window import gate
from tests.waves import Waves, fitted

SIGMA = 0.02


def carried_by(waves: Waves, recorded: torch.Tensor, names: list[str]) -> FreeForcing:
    """Return a free forcing on top of a law that was fitted."""
    law = waves.objective(recorded, SIGMA, names)
    begin = torch.zeros(law.modes + len(names), dtype=torch.float64)
    begin[: law.modes] = fitted(waves.objective(recorded, SIGMA))
    found = minimise(law, begin, 10, 1e-4)
    return force(law, found.phi, waves.size)[0]


def everything(waves: Waves, recorded: torch.Tensor) -> Objective:
    return waves.objective(recorded, SIGMA, list(waves.everything))


@pytest.mark.parametrize("names", [[], ["u: u**2"], ["u: u", "v: 1"]])
def test_a_term_is_found_whatever_carries_the_trajectory(waves: Waves, names: list[str]) -> None:
    recorded = waves.recorded(SIGMA, 1, [(waves.everything["u: u**2"], -0.15)])
    objective = everything(waves, recorded)
    forced = carried_by(waves, recorded, names)
    columns = objective.shooting.candidates
    problem = eliminated(objective, forced, columns, objective.prior_std)
    costs = problem.costs([(j,) for j in range(len(columns))])
    best = int(costs.argmin())
    assert str(columns[best]) == "u: u**2"
    # The law that carries the trajectory has no part in what the columns have to explain.
    assert problem.constant - float(costs[best]) > 100
    assert float(problem.coefficients((best,))[0]) == pytest.approx(-0.15, rel=0.1)


def test_a_gate_between_two_quantiles_screens_where_it_is(waves: Waves) -> None:
    term, edges = waves.everything["u: v**2"], [0.2, math.log(0.1)]
    recorded = waves.recorded(SIGMA, 1, [(localised([term], gate("u", 1).at(edges))[0], -0.4)])
    forced = carried_by(waves, recorded, [])
    shooting = forced.objective.shooting
    [states] = shooting.states(*forced.objective.split(forced.phi[None]))
    count = len(waves.everything)
    found = screen(everything(waves, recorded), count, range(count), forced, states)
    gates = [f for f in found if f.hypothesis.guess and f.hypothesis.guess.shape == gate("u", 1)]
    best = min(gates, key=lambda f: f.cost).hypothesis
    assert best.guess is not None
    assert [str(list(waves.everything.values())[j]) for j in best.inside] == ["u: v**2"]
    assert abs(best.guess.values[0] - 0.2) < 0.1 * float(states[:, 0].max() - states[:, 0].min())


def test_a_gate_that_acts_in_few_samples_is_screened_where_it_is(waves: Waves) -> None:
    states = waves.simulated()
    low = float(states[:, 0].quantile(0.01))
    term = waves.everything["u: 1"]
    window = gate("u", -1).at([low, math.log(0.02)])
    recorded = waves.recorded(SIGMA, 1, [(localised([term], window)[0], 1.5)])
    forced = carried_by(waves, recorded, [])
    count = len(waves.everything)
    found = screen(everything(waves, recorded), count, range(count), forced, states)
    best = min(found, key=lambda f: f.cost).hypothesis
    assert best.guess is not None and best.guess.shape.kind == "gate below"
    assert best.guess.values[0] < float(states[:, 0].quantile(0.05))


def test_a_term_beyond_the_library_is_found_about_a_law_of_it(waves: Waves) -> None:
    hidden = {str(candidate): candidate for candidate in waves.beyond}["u: sin(2*u)"]
    recorded = waves.recorded(SIGMA, 1, [(hidden, 0.3)])
    forced = carried_by(waves, recorded, ["u: u", "u: u**2"])
    inside = everything(waves, recorded)
    carried = forced.objective.shooting.candidates
    shooting = replace(
        inside.shooting, simulator=waves.simulator_beyond(carried), candidates=waves.beyond
    )
    scales = torch.tensor([c.scale for c in waves.beyond], dtype=torch.float64)
    found = laws_beyond(
        replace(inside, shooting=shooting, prior_std=scales), forced, len(waves.everything)
    )
    best = min(found, key=lambda cause: cause.law.score).law
    assert [candidate.key for candidate in best.candidates] == ["u: sin(2*u)"]
    assert float(best.coefficients[0]) == pytest.approx(0.3, rel=0.15)
