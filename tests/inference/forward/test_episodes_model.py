"""Several episodes: each equals its single run, and one law is fitted to all."""

from __future__ import annotations

from dataclasses import replace

import pytest
import torch

from dashred.inference.fit.fitted_law import build_law
from dashred.inference.fit.least_squares import LeastSquaresProblem
from dashred.inference.fit.levenberg_marquardt import minimise
from dashred.inference.fit.noise_model import NoiseModel
from dashred.inference.forward.candidate_simulator import CandidateSimulator
from dashred.inference.forward.episodes import (
    EpisodeStarts,
    concatenate_episodes,
    stack_readings,
    stack_times,
    without_padding,
)
from dashred.inference.forward.forward_model import ForwardModel
from dashred.inference.forward.law_block import LawBlock, WindowedTerms
from dashred.inference.forward.sensor_block import SensorBlock
from dashred.inference.forward.simulator import Simulator
from dashred.inference.hypotheses.hypothesis_fit import HypothesisFit
from dashred.inference.hypotheses.sensors.excluded_sensors import add_faults
from dashred.inference.hypotheses.sensors.fault_fits import fit_faults
from dashred.inference.sensor_faults.fault_search import FaultProblem
from dashred.inference.sensor_faults.fault_table import SEARCHED_KINDS, fault_in_units
from dashred.physics.forcing_basis import ForcingBasis
from dashred.physics.window import onset
from tests.swing import Swing, noisy

# Each has its own start, length and times; one begins at t = 60.
TIMES = [
    0.15 * torch.arange(61, dtype=torch.float64),
    60 + 0.15 * torch.arange(41, dtype=torch.float64),
    0.15 * torch.arange(61, dtype=torch.float64),
]
Z = [(1.0, -0.5), (-2.0, 0.3), (0.2, 1.5)]
LAW = ("x**3", "cos(2*t)")
XI = (-0.4, 0.3)
SIGMA = 0.02


def alone(swing: Swing, episode: int, names=LAW) -> ForwardModel:
    return replace(swing.forward_model(names), times=stack_times([TIMES[episode]]))


def together(swing: Swing, names=LAW) -> ForwardModel:
    return ForwardModel(
        Simulator([*swing.simulator.parts] * 3),
        EpisodeStarts((swing.estimate,) * 3),
        LawBlock([swing.everything[name] for name in names]),
        SensorBlock(swing.operator, 3),
        stack_times(TIMES),
    )


def readings(swing: Swing, xi=XI) -> list[torch.Tensor]:
    unknowns = torch.tensor([xi], dtype=torch.float64)
    starts = (torch.tensor([z], dtype=torch.float64) for z in Z)
    return [alone(swing, e).readings(z, unknowns)[0] for e, z in enumerate(starts)]


def objective(swing: Swing, recorded: list[torch.Tensor], names=LAW) -> LeastSquaresProblem:
    values = stack_readings(recorded)
    std = torch.full((values.shape[1],), SIGMA, dtype=torch.float64)
    noise = NoiseModel(std, torch.zeros_like(std), ~values.isnan())
    return LeastSquaresProblem(
        together(swing, names), values, noise, torch.ones(len(names)).double()
    )


@pytest.fixture
def z() -> torch.Tensor:
    return torch.tensor(Z, dtype=torch.float64).flatten()


def test_episodes_equal_single_runs_and_are_padded(swing, z):
    xi = torch.tensor(XI, dtype=torch.float64)
    [found] = together(swing).readings(z[None], xi[None])
    for e, expected in enumerate(readings(swing)):
        mine = found[:, 2 * e : 2 * e + 2]
        torch.testing.assert_close(mine[: len(expected)], expected)
        torch.testing.assert_close(
            mine[len(expected) :], expected[-1:].expand(len(mine) - len(expected), -1)
        )
    states = together(swing).sampled_states(z, xi)
    assert len(states) == sum(map(len, TIMES))


def test_padding_is_removed_from_times(swing):
    times = stack_times(TIMES)
    assert [len(without_padding(clock)) for clock in times.T] == [61, 41, 61]
    assert [len(without_padding(clock)) for clock in times[:45].T] == [45, 41, 45]
    flat = concatenate_episodes(times[..., None], times)[:, 0]
    torch.testing.assert_close(flat, torch.cat(TIMES))


def test_the_jacobian_is_the_derivative_of_the_readings(swing, z):
    forward_model, xi = together(swing), torch.tensor(XI, dtype=torch.float64)
    point = forward_model.linearise(z, xi)
    by_start, by_coefficients = forward_model._differences(z, xi).split([6, 2], dim=-1)
    recorded = ~stack_readings(readings(swing)).isnan()
    for mine, other in (
        (point.by_start, by_start),
        (point.by_coefficients, by_coefficients),
    ):
        torch.testing.assert_close(mine[recorded], other[recorded], atol=1e-5, rtol=1e-4)
        assert not mine[~recorded].any()
    # A start has no effect on another episode.
    assert not point.by_start[:, 2:, :2].any() and not point.by_start[:, :2, 2:].any()


def test_windows_and_forcings_use_the_times_of_the_episodes(swing, z):
    xi = torch.tensor([*XI, 0.0, 0.0], dtype=torch.float64)
    guess = torch.tensor([62.0, -1.0], dtype=torch.float64)
    inside = [swing.everything["x**3"]]
    everywhere = [swing.everything["cos(2*t)"]]
    both = together(swing, ("cos(2*t)",))
    part = CandidateSimulator(swing.system, swing.system.dt, [*everywhere, *inside], (onset(),))
    law = LawBlock(everywhere, WindowedTerms(inside, onset(), guess))
    local = replace(both, simulator=Simulator([part] * 3), law=law)
    order = xi[[1, 0, 2, 3]]
    [found] = local.readings(z[None], order[None])
    [without] = both.readings(z[None], order[None, :1])
    # Only the second of three episodes contains t = 62.
    torch.testing.assert_close(found[:, [0, 1, 4, 5]], without[:, [0, 1, 4, 5]])
    assert float((found - without)[:, 2:4].abs().max()) > 0.05
    forcing_basis = ForcingBasis.over(swing.system, both.times, 1, 5)
    assert forcing_basis.knots[0] == 0 and forcing_basis.knots[-1] == TIMES[1][-1]


def test_a_law_of_all_episodes_has_a_smaller_std(swing, z):
    recorded = [noisy(r, SIGMA, seed=e) for e, r in enumerate(readings(swing))]
    begin = torch.cat([0.5 * z, torch.zeros(2, dtype=torch.float64)])
    fitted = minimise(objective(swing, recorded), begin, 30, 1e-8)
    law = build_law(objective(swing, recorded), fitted, fitted.cost)
    stds = law.covariance.diagonal().sqrt()
    assert ((law.coefficients - torch.tensor(XI)) / stds).abs().max() < 3
    torch.testing.assert_close(fitted.phi[:6], z, atol=0.1, rtol=0.1)
    assert 0.8 < law.chi2 < 1.2
    assert law.start.shape == (3, 2)
    values = recorded[0]
    std = torch.full((2,), SIGMA, dtype=torch.float64)
    noise = NoiseModel(std, torch.zeros_like(std), ~values.isnan())
    single = LeastSquaresProblem(alone(swing, 0), values, noise, torch.ones(2).double())
    mine = minimise(single, torch.zeros(4).double(), 30, 1e-8)
    alone_stds = build_law(single, mine, 0.0).covariance.diagonal().sqrt()
    assert bool((stds < alone_stds).all())


def test_a_bias_is_shared_by_all_episodes(swing, z):
    recorded = [noisy(r, SIGMA, seed=e) for e, r in enumerate(readings(swing))]
    for part in recorded:
        part[:, 1] += 0.3
    posed = objective(swing, recorded)
    begin = torch.cat([z, torch.tensor(XI, dtype=torch.float64)])
    problem = FaultProblem.at(posed, begin, posed.linearise(begin))
    [bias] = problem.add_each([1], ["bias"])
    tested = fit_faults(posed, bias.faults, begin)
    assert float(tested.fitted.phi[-1]) == pytest.approx(0.3, abs=0.02)


def test_a_fault_of_one_episode_is_compared_with_its_sensor(swing, z):
    recorded = [noisy(r, SIGMA, seed=e) for e, r in enumerate(readings(swing))]
    recorded[1][20:, 0] = recorded[1][20, 0]
    posed = objective(swing, recorded)
    phi = torch.cat([z, torch.tensor(XI, dtype=torch.float64)])
    problem = FaultProblem.at(posed, phi, posed.linearise(phi))
    found = [each.faults.faults[0] for each in problem.add_each(range(6), SEARCHED_KINDS)]
    kinds = [(fault.kind, fault.sensor) for fault in found]
    # The column is in the second of three episodes with two sensors each.
    assert ("stuck", 2) in kinds
    assert {sensor for kind, sensor in kinds if kind == "bias"} == {0, 1}
    [stuck] = [fault for fault in found if fault.kind == "stuck"]
    told = fault_in_units(posed, stuck, torch.zeros(0), torch.zeros(0))
    assert told.sensor == "place" and told.begin == pytest.approx(63.0, abs=0.2)
    assert told.episode == 1
    law = build_law(posed, minimise(posed, phi, 3, 1e-3), 0.0)
    [fault] = add_faults(HypothesisFit(law, posed, phi), (stuck.sensor,)).law.faults
    assert fault.kind == "stuck"


@pytest.mark.parametrize("block_size", [1, 100, 10**9])
def test_starts_may_have_different_numbers_of_modes(
    swing: Swing, block_size: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("dashred.inference.forward.simulator.BLOCK_SIZE", block_size)
    modes = swing.estimate.modes
    few, many = replace(swing.estimate, modes=modes[:1]), replace(swing.estimate, modes=modes * 2)
    forward_model = replace(together(swing), start=EpisodeStarts((few, many, few)))
    z, xi = torch.tensor([0.3, -0.2, 0.5, 1.0]).double(), torch.tensor(XI).double()
    found, expected = forward_model._columns(z, xi), forward_model._differences(z, xi)
    recorded = ~stack_readings(readings(swing)).isnan()
    torch.testing.assert_close(found[recorded], expected[recorded], atol=1e-5, rtol=1e-4)
    assert not found[~recorded].any()
