"""Sensors that wander, and several faulty sensors, of a decaying oscillator."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import pytest
import torch
from torch import Tensor

from dashred.data.observation_operator import ObservationOperator
from dashred.data.sensors import Sensor
from dashred.inference.fit.fitted_law import build_law
from dashred.inference.fit.law import Law
from dashred.inference.fit.least_squares import LeastSquaresProblem
from dashred.inference.fit.levenberg_marquardt import minimise
from dashred.inference.fit.noise_model import NoiseModel
from dashred.inference.forward.candidate_simulator import CandidateSimulator
from dashred.inference.forward.candidates import Candidate
from dashred.inference.forward.episodes import EpisodeStarts, stack_readings, stack_times
from dashred.inference.forward.forward_model import ForwardModel
from dashred.inference.forward.law_block import LawBlock
from dashred.inference.forward.sensor_block import SensorBlock
from dashred.inference.forward.simulator import Simulator
from dashred.inference.hypotheses.hypothesis_fit import HypothesisFit, refit
from dashred.inference.hypotheses.sensors import fault_fits
from dashred.inference.hypotheses.sensors.fault_fits import fit_sensor_hypotheses
from dashred.inference.initial_state.start_models import LinearStart
from dashred.inference.sensor_faults.error_curve import follows_state
from dashred.inference.sensor_faults.fault import choice_penalty
from dashred.inference.sensor_faults.fault_search import (
    FaultProblem,
    FaultSet,
    costs_without_worst,
    find_faults,
    largest_count,
)
from dashred.inference.sensor_faults.fault_table import SEARCHED_KINDS
from dashred.physics.solvers.simulate import simulate
from dashred.physics.system import Term
from tests import laws

TEXT = """
system:
  title: decaying oscillator
  fields: {x: place, v: velocity}
  equations: {x: v, v: -x - 0.2*v}
  start: {x: 1, v: 0}
  spread: {x: 0.3, v: 0.3}
  integrator: {dt: 0.1}
recording: {twin: a, sensors: 2, noise: 0, duration: 12, every: 0.1}
"""
NAMES = ("x1", "x2", "x3", "v1", "v2")
SENSORS = tuple(Sensor(name, name[0]) for name in NAMES)
TIMES = 0.1 * torch.arange(121, dtype=torch.float64)
SHARE = TIMES / TIMES[-1]
SIGMA = 0.02
WANDER = 0.15 * torch.sin(2 * math.pi * 1.2 * SHARE + 0.4)


@dataclass(frozen=True)
class Oscillator:
    """The compiled oscillator; its truths are exact runs of it."""

    simulator: Simulator
    candidates: tuple[Candidate, ...]

    def problem(self, recorded: Tensor, terms: int = 0, episodes: int = 1) -> LeastSquaresProblem:
        """Return F with the first of the candidates."""
        system = self.simulator.system
        mean = torch.tensor([1.0, 0.0], dtype=torch.float64)
        start = EpisodeStarts((LinearStart(mean, 0.3 * torch.eye(2).double()),) * episodes)
        block = SensorBlock(ObservationOperator(SENSORS, system), episodes)
        law = LawBlock(self.candidates[:terms])
        simulator = Simulator(list(self.simulator.parts) * episodes)
        model = ForwardModel(simulator, start, law, block, stack_times([TIMES] * episodes))
        std = torch.full((recorded.shape[1],), SIGMA, dtype=torch.float64)
        noise = NoiseModel(std, torch.zeros_like(std), ~recorded.isnan())
        return LeastSquaresProblem(model, recorded, noise, torch.ones(terms).double())

    def recorded(self, seed: int, damping: float = 0.0) -> Tensor:
        """Return noisy readings; the damping is what the simulator lacks, ``(time, sensor)``."""
        system = self.simulator.system
        term = system.parse("v", "test", equation="v")
        other = system.with_terms([(Term("v", term), -damping)])
        generator = torch.Generator().manual_seed(seed)
        begin = torch.tensor([[1.1, -0.2]], dtype=torch.float64)
        clean = ObservationOperator(SENSORS, system)(simulate(other, begin, TIMES))[0]
        return clean + SIGMA * torch.randn(clean.shape, generator=generator).double()


@pytest.fixture(scope="module")
def oscillator(tmp_path_factory: pytest.TempPathFactory) -> Oscillator:
    """The oscillator, with terms of the force as candidates."""
    system = laws.declared(tmp_path_factory.mktemp("oscillator"), TEXT)
    terms = tuple(laws.term(system, "v", text) for text in ("v", "x**3", "v**3", "1", "x**2"))
    return Oscillator(Simulator([CandidateSimulator(system, system.dt, terms)]), terms)


def fitted(objective: LeastSquaresProblem, penalty: float = 0.0) -> HypothesisFit:
    """Return a law without faults, fitted."""
    size = objective.modes + len(objective.prior_std)
    found = minimise(objective, torch.zeros(size).double(), 30, 1e-8)
    law = build_law(objective, found, found.cost + penalty)
    return HypothesisFit(law, objective, found.phi)


def faults_of(objective: LeastSquaresProblem, count: int = 2) -> FaultSet:
    """Return the faults that the linearised problem shows."""
    fit = fitted(objective)
    problem = FaultProblem.at(objective, fit.phi, fit.normal)
    return find_faults(problem, range(objective.recorded.shape[1]), SEARCHED_KINDS, count)


def best_law(fit: HypothesisFit, bound: float) -> Law:
    """Return the best hypothesis with faults."""
    return min((each.law for each in fit_sensor_hypotheses(fit, bound)), key=lambda law: law.score)


def test_a_wandering_sensor_is_named_and_drawn(oscillator: Oscillator) -> None:
    recorded = oscillator.recorded(seed=1)
    recorded[:, 1] += WANDER
    null = fitted(oscillator.problem(recorded))
    best = best_law(null, null.law.score)
    [fault] = best.faults
    assert (fault.kind, fault.sensor) == ("wandering", "x2")
    [curve] = fault.curves
    assert len(curve.times) == len(curve.value) == len(curve.std) <= 101
    times = torch.tensor(curve.times).double()
    value, std = torch.tensor(curve.value), torch.tensor(curve.std)
    true = 0.15 * torch.sin(2 * math.pi * 1.2 * times / TIMES[-1] + 0.4)
    assert float(((value - true) / std).square().mean().sqrt()) < 2
    assert float((value - true).square().mean().sqrt()) < 0.2 * 0.15
    assert best.score < null.law.score - 100 and best.chi2 < 1.15


def test_a_wandering_sensor_beats_five_terms(oscillator: Oscillator) -> None:
    recorded = oscillator.recorded(seed=2)
    recorded[:, 0] += WANDER
    null = fitted(oscillator.problem(recorded))
    terms = fitted(oscillator.problem(recorded, terms=5), penalty=5 * math.log(recorded.numel()))
    best = best_law(null, terms.law.score)
    assert [fault.kind for fault in best.faults] == ["wandering"]
    assert best.score < terms.law.score - 50


def test_a_law_and_a_wandering_sensor_are_both_found(oscillator: Oscillator) -> None:
    recorded = oscillator.recorded(seed=3, damping=0.1)
    recorded[:, 3] += WANDER
    null = fitted(oscillator.problem(recorded))
    law = fitted(oscillator.problem(recorded, terms=1), penalty=math.log(recorded.numel()))
    best = best_law(law, law.law.score)
    assert [(fault.kind, fault.sensor) for fault in best.faults] == [("wandering", "v1")]
    assert float(best.coefficients[0]) == pytest.approx(-0.1, abs=4 * float(best.std[0]))
    assert best.score < best_law(null, math.inf).score - 50


def test_two_faulty_sensors_are_found_with_their_kinds(oscillator: Oscillator) -> None:
    recorded = oscillator.recorded(seed=4)
    recorded[:, 0] += 0.1
    recorded[:, 4] += WANDER
    null = fitted(oscillator.problem(recorded))
    best = best_law(null, null.law.score)
    found = {(fault.sensor, fault.kind): fault for fault in best.faults}
    assert found.keys() == {("x1", "bias"), ("v2", "wandering")}
    bias = found["x1", "bias"]
    assert bias.std is not None and abs(bias.value - 0.1) < 4 * bias.std < 0.1
    assert "bias of v2" in best.parts and "wandering of v2" in best.parts


@pytest.mark.parametrize(
    ("error", "kind"), [(0.1 + 0 * SHARE, "bias"), (0.2 * SHARE, "drift"), (WANDER, "wandering")]
)
def test_the_plainest_name_is_given(oscillator: Oscillator, error: Tensor, kind: str) -> None:
    recorded = oscillator.recorded(seed=5)
    recorded[:, 2] += error
    [fault] = faults_of(oscillator.problem(recorded)).faults
    assert (fault.kind, fault.sensor) == (kind, 2)


def test_sound_sensors_give_no_false_alarm(oscillator: Oscillator) -> None:
    alarms = [bool(faults_of(oscillator.problem(oscillator.recorded(s))).faults) for s in range(50)]
    assert sum(alarms) <= 1


def test_two_sensors_do_not_wander(oscillator: Oscillator) -> None:
    """A curve of one of two sensors would explain any missing law."""
    recorded = oscillator.recorded(seed=6)
    recorded[:, 2] += WANDER
    recorded[:, [0, 1, 3, 4]] = torch.nan
    objective = oscillator.problem(recorded)
    assert all(fault.kind != "wandering" for fault in faults_of(objective).faults)


def test_a_sensor_wanders_in_each_episode_on_its_own(oscillator: Oscillator) -> None:
    first, second = oscillator.recorded(seed=7), oscillator.recorded(seed=8)
    first[:, 1] += WANDER
    second[:, 1] -= 2 * WANDER
    recorded = stack_readings([first, second])
    null = fitted(oscillator.problem(recorded, episodes=2))
    [fault] = best_law(null, null.law.score).faults
    assert (fault.kind, fault.sensor) == ("wandering", "x2")
    assert [curve.episode for curve in fault.curves] == [0, 1]
    sizes = [max(map(abs, curve.value)) for curve in fault.curves]
    assert sizes == pytest.approx([0.15, 0.3], abs=0.04)


def test_the_faults_are_refitted_with_the_law(oscillator: Oscillator) -> None:
    """Under another noise the curve is fitted again, not kept."""
    recorded = oscillator.recorded(seed=9)
    recorded[:, 1] += WANDER
    null = fitted(oscillator.problem(recorded))
    best = min(fit_sensor_hypotheses(null, null.law.score), key=lambda fit: fit.law.score)
    again = refit(best, best.objective.truncate(len(TIMES)))
    [before], [after] = best.law.faults, again.law.faults
    assert after.kind == "wandering" and after.value == pytest.approx(before.value, rel=0.05)
    louder = refit(
        best,
        LeastSquaresProblem(
            best.objective.forward_model,
            best.objective.recorded,
            best.objective.noise.scaled(2.0),
            best.objective.prior_std,
        ),
    )
    [wide] = louder.law.faults
    assert wide.std is not None and before.std is not None and wide.std > 1.3 * before.std


def test_an_error_with_the_same_course_in_every_episode_follows_the_state() -> None:
    clock = np.linspace(0, 6, 40)
    rise, wave = (clock**2).tolist(), np.sin(2 * clock).tolist()
    assert follows_state([rise, (1.3 * clock**2 + 0.1 * np.sin(9 * clock)).tolist()])
    assert not follows_state([rise, wave]) and not follows_state([rise])
    # A constant error has no course.
    assert not follows_state([[1.0] * 40, [1.0] * 40])


def test_faults_that_cannot_explain_a_misfit_are_not_searched(
    oscillator: Oscillator, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A missing force is seen by all sensors; without the two worst ones it is still there."""
    null = fitted(oscillator.problem(oscillator.recorded(seed=3, damping=0.1)))
    law = fitted(oscillator.problem(oscillator.recorded(seed=3, damping=0.1), terms=1))
    problem = FaultProblem.at(null.objective, null.phi, null.normal)
    assert costs_without_worst(problem, 0)[0] == pytest.approx(problem.linear.cost)
    least = costs_without_worst(problem, 2)[2]
    assert law.law.score + 100 < least < problem.linear.cost + 2 * len(TIMES)
    monkeypatch.setattr(fault_fits, "find_faults", None)
    assert fit_sensor_hypotheses(null, law.law.score + 6) == []


def test_the_cost_without_a_faulty_sensor_is_the_noise(oscillator: Oscillator) -> None:
    recorded = oscillator.recorded(seed=1)
    recorded[:, 1] += WANDER
    null = fitted(oscillator.problem(recorded))
    problem = FaultProblem.at(null.objective, null.phi, null.normal)
    assert costs_without_worst(problem, 1)[1] / recorded.numel() == pytest.approx(1.0, abs=0.15)


def test_faults_that_cost_more_than_the_bound_are_not_searched(oscillator: Oscillator) -> None:
    """Each fault costs at least the choice of its kind and sensor."""
    recorded = oscillator.recorded(seed=1)
    recorded[:, 1] += WANDER
    null = fitted(oscillator.problem(recorded))
    problem = FaultProblem.at(null.objective, null.phi, null.normal)
    costs = costs_without_worst(problem, largest_count(problem.objective))
    scores = [cost + k * choice_penalty(recorded.shape[1]) for k, cost in enumerate(costs)]
    least = min(scores[1:])
    assert fault_fits._useful_count(problem, least - 1, 0.0) == 0
    assert fault_fits._useful_count(problem, least, 0.0) == scores.index(least)
    assert fault_fits._useful_count(problem, max(scores[1:]), 0.0) == len(scores) - 1 > 1
    # One fault that may have dragged the fit is searched in any case.
    assert fault_fits._useful_count(problem, least - 1, costs[1]) == 1


def test_one_fault_is_tried_where_several_explain_no_more(
    oscillator: Oscillator, monkeypatch: pytest.MonkeyPatch
) -> None:
    """One sensor carries most of the misfit, and a missing force the rest."""
    recorded = oscillator.recorded(seed=3, damping=0.1)
    law = fitted(oscillator.problem(recorded, terms=1))
    recorded[:, 1] += 20 * WANDER
    null = fitted(oscillator.problem(recorded))
    monkeypatch.setattr(fault_fits, "find_faults", None)
    found = fit_sensor_hypotheses(null, law.law.score + 6)
    assert {fault.sensor for each in found for fault in each.faults} == {1}
