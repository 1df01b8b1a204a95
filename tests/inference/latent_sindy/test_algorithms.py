"""Algorithms 1 and 2 with the true state of a linear system."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch
from torch import Tensor

from dashred.config import load_config
from dashred.core.errors import InputError
from dashred.data.observation_operator import ObservationOperator
from dashred.inference.latent_sindy.algorithms import compressed_search
from dashred.inference.latent_sindy.latent_sindy import LatentProblem, LatentSindy
from dashred.inference.latent_sindy.sensor_encoding import HistoryEncoder
from dashred.inference.latent_sindy.sparse_regression import SparseFit, sparse_fit
from dashred.inference.latent_sindy.step_sensitivities import forecast_steps, tangents
from dashred.models.assimilation import AssimilatedEncoder, LatentTransform
from dashred.models.lag_windows import windows
from dashred.physics.runs.ensemble import term_scales
from dashred.physics.solvers.simulate import simulate
from dashred.physics.system import System
from tests import ring

LAGS = 6
MISSING = {"u": -0.05, "d(u, x)": -0.08, "d(u, x, 2)": 0.02, "u**2": 0.03}


@pytest.fixture
def system(tmp_path):
    return ring.linear_system(tmp_path)


def truth(system: System, terms: dict[str, float], seed: int = 4) -> Tensor:
    """Simulate the system with terms added, ``(time, field, x)``."""
    added = [(t, terms[str(t)]) for t in ring.library(system) if str(t) in terms]
    assert len(added) == len(terms)
    lawful = system.with_terms(added)
    return simulate(lawful, ring.starts(system, 1, seed), ring.TIMES)[0]


def build_problem(system: System, states: Tensor, tmp_path) -> LatentProblem:
    """Return the problem with the sensors of the true state and candidate terms."""
    nominal = ring.ensemble(system, 1).states[0]
    library = ring.library(system)
    operator = ObservationOperator(ring.SENSORS, system)
    settings = load_config([f"conf={tmp_path}/ring.yaml"], entry="test").latent_sindy
    scales = term_scales(system, library, nominal, 0.0)
    seen = windows(operator(states), LAGS)
    return LatentProblem(system, library, scales, operator, ring.TIMES, seen, settings, 0)


def untrained(problem: LatentProblem) -> AssimilatedEncoder:
    states = ring.ensemble(problem.system, 5).states
    shred = ring.untrained(states, problem.operator)
    return AssimilatedEncoder(shred, LatentTransform(24, 8).double())


def proposals(system: System, states: Tensor, tmp_path) -> dict[str, SparseFit]:
    problem = build_problem(system, states, tmp_path)
    return LatentSindy(problem, states, 12).propose(untrained(problem), states, 10)


def proposed(fit: SparseFit) -> dict[str, float]:
    return {
        name: float(value)
        for name, value in zip(ring.LIBRARY, fit.coefficients, strict=True)
        if value
    }


@pytest.mark.parametrize(("term", "coefficient"), MISSING.items())
def test_algorithm_1_is_exact_with_the_true_state(system, tmp_path, term, coefficient):
    found = proposals(system, truth(system, {term: coefficient}), tmp_path)["alg1"]
    assert proposed(found) == {term: pytest.approx(coefficient, rel=0.01)}
    assert ring.LIBRARY[found.ranking[0]] == term
    assert dict(found.path)[1] < 0.02


def test_algorithm_1_finds_two_terms(system, tmp_path):
    law = {"u": -0.05, "d(u, x)": 0.04}
    found = proposals(system, truth(system, law), tmp_path)["alg1"]
    assert proposed(found) == {term: pytest.approx(c, rel=0.01) for term, c in law.items()}


# Its columns are read at the begin of a step and its target is an increment over it, so it is
# no more than close: within 5 % for these terms, 20-30 % for u_xx and u², beside spurious ones.
@pytest.mark.parametrize("term", ["u", "d(u, x)"])
def test_algorithm_2_is_close_with_the_true_state(system, tmp_path, term):
    found = proposals(system, truth(system, {term: MISSING[term]}), tmp_path)["alg2"]
    assert ring.LIBRARY[found.ranking[0]] == term
    assert found.coefficients[found.ranking[0]] == pytest.approx(MISSING[term], rel=0.05)


def test_a_perfect_simulator_gets_no_term(system, tmp_path):
    states = truth(system, {})
    generator = torch.Generator().manual_seed(0)
    noise = 1e-3 * torch.randn(states.shape, generator=generator, dtype=torch.float64)
    for found in proposals(system, states + noise, tmp_path).values():
        assert proposed(found) == {}


def test_the_proposal_depends_on_the_given_field(system, tmp_path):
    # With the simulator's own field, Algorithm 1 has no information.
    states = truth(system, {"u": -0.05})
    problem = build_problem(system, states, tmp_path)
    blind = simulate(system, states[:1], ring.TIMES)[0]
    found = LatentSindy(problem, blind, 12).propose(untrained(problem), blind, 10)["alg1"]
    assert np.abs(found.coefficients).max() < 1e-6


def test_columns_are_derivatives_of_the_forecast(system):
    # On a linear system they have a closed form: ∂Φ/∂ξ = t θ(Φ) for linear θ.
    states = truth(system, {})
    library = ring.library(system)
    scales = torch.full((len(library),), 0.1, dtype=torch.float64)
    begins = torch.tensor([6, 11])
    steps = forecast_steps(system, states, ring.TIMES, begins, [1, 4])
    columns = tangents(system, library, scales, states, ring.TIMES, steps)
    for step, column, duration in zip(steps, columns, (0.1, 0.4), strict=True):
        torch.testing.assert_close(step.forecast, states[step.ends], rtol=1e-6, atol=1e-8)
        torch.testing.assert_close(
            column[:, ring.LIBRARY.index("u")], duration * step.forecast, rtol=1e-3, atol=1e-6
        )
        drift = torch.stack([system.evaluate("d(u, x)", s) for s in step.forecast])
        torch.testing.assert_close(
            column[:, ring.LIBRARY.index("d(u, x)"), 0], duration * drift, rtol=1e-3, atol=2e-4
        )


def test_columns_at_the_midpoint_follow_a_front(system):
    """In steepening waves their error is less than half of that of columns at the forecast."""
    library = ring.library(system)
    burgers = system.with_terms([(library[ring.LIBRARY.index("u*d(u, x)")], -0.5)])
    decay = ring.LIBRARY.index("u")
    lawful = burgers.with_terms([(library[decay], -0.15)])
    states = simulate(lawful, ring.starts(system, 1, 4), ring.TIMES)[0]
    scales = torch.ones(len(library), dtype=torch.float64)
    [step] = forecast_steps(burgers, states, ring.TIMES, torch.tensor([6]), [10])
    forecast = states.clone()
    forecast[6:17] = step.path[0]
    gap = states[step.ends] - step.forecast
    missed = []
    for about in (states, forecast):
        [column] = tangents(burgers, library, scales, about, ring.TIMES, [step])
        missed.append(float((gap + 0.15 * column[:, decay]).norm() / gap.norm()))
    assert missed[0] < missed[1] / 2


def test_a_term_without_effect_on_the_sensors_is_not_proposed(system, tmp_path):
    states = truth(system, {"u": -0.05})
    problem = build_problem(system, states, tmp_path)
    steps = forecast_steps(system, states, ring.TIMES, torch.arange(6, 30, 4), [1])
    columns = tangents(system, problem.library, problem.scales, states, ring.TIMES, steps)
    columns[0][:, 3] = 0.0
    shred = ring.untrained(ring.ensemble(system, 5).states, problem.operator)
    encoder = HistoryEncoder(shred.encode, problem.operator, states, LAGS)
    blocks = compressed_search(encoder, states, steps, columns, problem.scales)
    found = sparse_fit(blocks, 0.05, 3, np.random.default_rng(0))
    assert found.coefficients[3] == 0.0
    assert ring.LIBRARY[found.ranking[0]] == "u"


@pytest.mark.parametrize("huge", [1e100, float("nan")])
def test_a_step_that_blows_up_is_left_out(system, tmp_path, huge):
    states = truth(system, {"u": -0.05})
    problem = build_problem(system, states, tmp_path)
    begins = torch.arange(6, 30, 4)
    steps = forecast_steps(system, states, ring.TIMES, begins, [1])
    columns = tangents(system, problem.library, problem.scales, states, ring.TIMES, steps)
    shred = ring.untrained(ring.ensemble(system, 5).states, problem.operator)
    encoder = HistoryEncoder(shred.encode, problem.operator, states, LAGS)
    columns[0][2, 3] = huge
    blocks = compressed_search(encoder, states, steps, columns, problem.scales)
    assert len(blocks.power) == len(begins) - 1
    found = sparse_fit(blocks, 0.05, 3, np.random.default_rng(0))
    assert ring.LIBRARY[found.ranking[0]] == "u"
    assert found.coefficients[ring.LIBRARY.index("u")] == pytest.approx(-0.05, rel=0.1)


@pytest.mark.parametrize("huge", [1e30, float("inf"), float("nan")])
def test_a_term_that_blows_up_is_not_proposed(system, tmp_path, huge):
    """Three of four steps blow up under one term; the others are not lost with it."""
    states = truth(system, {"u": -0.05})
    problem = build_problem(system, states, tmp_path)
    steps = forecast_steps(system, states, ring.TIMES, torch.arange(6, 30, 2), [1])
    columns = tangents(system, problem.library, problem.scales, states, ring.TIMES, steps)
    unstable = ring.LIBRARY.index("d(u, x, 3)")
    columns[0][torch.arange(12) % 4 > 0, unstable] = huge
    shred = ring.untrained(ring.ensemble(system, 5).states, problem.operator)
    encoder = HistoryEncoder(shred.encode, problem.operator, states, LAGS)
    blocks = compressed_search(encoder, states, steps, columns, problem.scales)
    assert len(blocks.power) == 12
    found = sparse_fit(blocks, 0.05, 3, np.random.default_rng(0))
    assert found.coefficients[unstable] == 0.0
    assert found.coefficients[ring.LIBRARY.index("u")] == pytest.approx(-0.05, rel=0.1)


def test_the_history_ends_with_the_given_field(system):
    states = truth(system, {})
    operator = ObservationOperator(ring.SENSORS, system)
    encoder = HistoryEncoder(lambda seen: seen.flatten(1), operator, states, LAGS)
    other = torch.full((2, 1, 32), 7.0, dtype=torch.float64)
    seen = encoder(torch.tensor([8, 20]), other).reshape(2, LAGS + 1, -1)
    torch.testing.assert_close(seen[:, -1], torch.full((2, 6), 7.0, dtype=torch.float64))
    torch.testing.assert_close(seen[1, :-1], operator(states[20 - LAGS : 20]))
    # The history itself is unchanged.
    torch.testing.assert_close(encoder.windows[20, -1], operator(states[20]))


def test_the_encoding_of_a_change_is_the_derivative_of_the_encoding(system):
    states = truth(system, {})
    operator = ObservationOperator(ring.SENSORS, system)
    generator = torch.Generator().manual_seed(0)
    weights = 0.3 * torch.randn(6, 4, dtype=torch.float64, generator=generator)
    encoder = HistoryEncoder(lambda seen: torch.tanh(seen[:, -1] @ weights), operator, states, LAGS)
    times, fields = torch.tensor([8, 20]), states[[8, 20]]
    shape = (2, 3, *fields.shape[1:])
    moves = 1e-4 * torch.randn(shape, dtype=torch.float64, generator=generator)
    base, moved = encoder.linearise(times, fields, moves)
    torch.testing.assert_close(base, encoder(times, fields))
    for j in range(3):
        exact = encoder(times, fields + moves[:, j]) - base
        # As a share of the whole: single components may nearly cancel.
        assert (moved[:, j] - exact).norm() < 2e-3 * exact.norm()


def test_steps_start_with_full_histories_and_end_within_the_record(system, tmp_path):
    problem = build_problem(system, truth(system, {}), tmp_path)
    begins = problem.begins(9)
    assert begins[0] == LAGS
    assert begins[-1] + 3 == len(ring.TIMES) - 1
    assert len(begins) == 9
    short = replace(problem, times=ring.TIMES[:8], windows=problem.windows[:8])
    assert short.begins(9).tolist() == [4]


def test_steps_longer_than_the_record_are_refused(system, tmp_path):
    problem = build_problem(system, truth(system, {}), tmp_path)
    short = replace(problem, times=ring.TIMES[:3])
    assert short.strides == [1]
    with pytest.raises(InputError, match="shorter than every step"):
        replace(problem, times=ring.TIMES[:2]).strides  # noqa: B018


def test_the_same_seed_proposes_the_same(system, tmp_path):
    states = truth(system, {"u": -0.05})
    first, again = (proposals(system, states, tmp_path) for _ in range(2))
    for name in ("alg1", "alg2"):
        np.testing.assert_array_equal(first[name].coefficients, again[name].coefficients)
        np.testing.assert_array_equal(first[name].inclusion, again[name].inclusion)
