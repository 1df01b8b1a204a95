"""A faulty sensor is found with its fault; sound sensors are not suspected."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest
import torch
from torch import Tensor

from dashred.data.observation_operator import ObservationOperator
from dashred.data.sensors import Sensor
from dashred.inference.fit.law import SensorFault
from dashred.inference.fit.least_squares import LeastSquaresProblem
from dashred.inference.forward.candidate_simulator import CandidateSimulator
from dashred.inference.forward.episodes import EpisodeStarts, stack_times
from dashred.inference.forward.forward_model import ForwardModel
from dashred.inference.forward.law_block import LawBlock
from dashred.inference.forward.sensor_block import SensorBlock
from dashred.inference.forward.simulator import Simulator
from dashred.inference.hypotheses.hypothesis_fit import HypothesisFit
from dashred.inference.hypotheses.sensors.fault_fits import fit_faults, fit_sensor_hypotheses
from dashred.inference.sensor_faults.fault import CountedParameters
from dashred.inference.sensor_faults.fault_search import FaultProblem
from dashred.inference.sensor_faults.fault_table import SEARCHED_KINDS
from dashred.physics.runs.initial_state_prior import StartPrior, field_rms, nominal_start
from dashred.physics.solvers.simulate import simulate
from tests import laws
from tests.waves import TIMES, Waves, fitted

SIGMA = 0.03
PLANE = """
system:
  title: warmth in a plane
  axes: {x: {length: 10, points: 12}, y: {length: 8, points: 12}}
  fields: {u: temperature}
  equations: {u: "0.1*lap(u) - 0.3*d(u, x)"}
  start: {u: cos(2*pi*x/10)*cos(2*pi*y/8)}
  spread: {u: 0.2, length: 3}
  integrator: {dt: 0.1}
recording: {twin: a, sensors: 3, noise: 0, duration: 4, every: 0.1}
"""


def biased(values: Tensor) -> Tensor:
    values[:, 2] += 0.12
    return values


def drifting(values: Tensor) -> Tensor:
    values[:, 4] += 0.03 * TIMES
    return values


def stuck(values: Tensor) -> Tensor:
    values[25:, 1] = values[25, 1]
    return values


def spiky(values: Tensor) -> Tensor:
    values[[7, 20, 21], 3] += torch.tensor([1.0, -1.2, -1.2], dtype=torch.float64)
    return values


def searched(objective: LeastSquaresProblem) -> tuple[float, list[SensorFault], float]:
    """Return the score without a fault, the faults with the best first, and the best score."""
    phi = fitted(objective)
    [cost], _ = objective.values(phi[None])
    law = laws.law(score=float(cost))
    fits = fit_sensor_hypotheses(HypothesisFit(law, objective, phi), float(cost))
    found = sorted((fit.law for fit in fits), key=lambda law: law.score)
    assert all(not law.candidates for law in found)
    best = found[0].score if found else float("inf")
    return float(cost), [fault for law in found for fault in law.faults], best


@pytest.mark.parametrize(
    ("break_", "kind", "sensor", "value"),
    [
        (biased, "bias", "s2", 0.12),
        (drifting, "drift", "s4", 0.03),
        (stuck, "stuck", "s1", None),
        (spiky, "spikes", "s3", 3.0),
    ],
)
def test_the_faulty_sensor_and_its_fault_are_found(
    waves: Waves, break_: Callable[[Tensor], Tensor], kind: str, sensor: str, value: float | None
) -> None:
    recorded = break_(waves.recorded(SIGMA, seed=3))
    without, found, best = searched(waves.objective(recorded, SIGMA))
    assert (found[0].kind, found[0].sensor) == (kind, sensor)
    assert best < without - 20
    if value is None:
        assert found[0].value == pytest.approx(float(recorded[25, 1]))
        assert found[0].begin == pytest.approx(float(TIMES[25]))
    elif found[0].std is None:
        assert found[0].value == value
    else:
        assert abs(found[0].value - value) < 4 * found[0].std < 0.5 * value


def test_a_sensor_that_never_worked_is_stuck_from_the_first_sample(waves: Waves) -> None:
    recorded = waves.recorded(SIGMA, seed=3)
    recorded[:, 1] = 2.0
    without, found, best = searched(waves.objective(recorded, SIGMA))
    assert (found[0].kind, found[0].sensor, found[0].begin) == ("stuck", "s1", float(TIMES[0]))
    assert found[0].value == 2.0 and best < without - 20


@pytest.mark.parametrize("off", [0.12, -0.45])
def test_a_misplaced_sensor_is_found_with_its_distance(waves: Waves, off: float) -> None:
    recorded = waves.recorded(SIGMA, seed=4)
    objective = waves.objective(recorded, SIGMA)
    sensors = list(waves.operator.sensors)
    [place] = sensors[0].position
    sensors[0] = replace(sensors[0], position=((place - off) % 10,))
    believed = ObservationOperator(sensors, waves.system)
    forward_model = replace(objective.forward_model, sensors=SensorBlock(believed))
    wrong = replace(objective, forward_model=forward_model)
    without, [best, *_], score = searched(wrong)
    assert (best.kind, best.sensor) == ("misplaced", "s0") and score < without - 20
    assert best.std is not None and best.value == pytest.approx(off, abs=4 * best.std)


def test_sound_sensors_are_not_suspected(waves: Waves) -> None:
    objective = waves.objective(waves.recorded(SIGMA, seed=5), SIGMA)
    _, found, _ = searched(objective)
    assert found == []


def problem_at(objective: LeastSquaresProblem, phi: Tensor) -> FaultProblem:
    """Return the linearised problem about a fit, without faults."""
    return FaultProblem.at(objective, phi, objective.linearise(phi))


def count_parameters(objective: LeastSquaresProblem) -> dict[str, set[tuple[int, float]]]:
    """Return by kind the numbers of fitted parameters and of parameters in the penalty."""
    problem = problem_at(objective, torch.zeros(objective.modes, dtype=torch.float64))
    found: dict[str, set[tuple[int, float]]] = {}
    for added in problem.add_each(range(objective.recorded.shape[1]), SEARCHED_KINDS):
        [fault], [parameters] = added.faults.faults, added.faults.parameters
        if len(parameters) and isinstance(fault.complexity, CountedParameters):
            own = found.setdefault(fault.kind, set())
            own.add((len(parameters), fault.complexity.count))
    return found


@pytest.mark.slow
def test_the_penalty_counts_every_parameter_that_is_fitted(waves: Waves, tmp_path: Path) -> None:
    ring = count_parameters(waves.objective(waves.recorded(SIGMA, seed=5), SIGMA))
    assert ring == {"bias": {(1, 1.0)}, "drift": {(1, 1.0)}, "misplaced": {(1, 1.0)}}

    system = laws.declared(tmp_path, PLANE)
    nominal = nominal_start(system)
    sensors = [Sensor(f"s{j}", "u", (1.3 + 3 * j, 0.7 + 2 * j)) for j in range(3)]
    operator = ObservationOperator(sensors, system)
    start = EpisodeStarts((StartPrior(system, nominal[0], field_rms(nominal), None),))
    simulator = Simulator([CandidateSimulator(system, system.dt, [])])
    recorded = operator(simulate(system, nominal, TIMES))[0]
    block, times = SensorBlock(operator), stack_times([TIMES])
    forward_model = ForwardModel(simulator, start, LawBlock([]), block, times)
    none = torch.zeros(0, dtype=torch.float64)
    plane = count_parameters(
        LeastSquaresProblem(forward_model, recorded, waves.noise(recorded, SIGMA), none)
    )
    assert plane == ring | {"misplaced": {(2, 2.0)}}


def test_the_prediction_agrees_with_the_fit_if_the_readings_are_nearly_linear(waves: Waves) -> None:
    objective = waves.objective(biased(waves.recorded(SIGMA, seed=3)), SIGMA)
    phi = fitted(objective)
    every = problem_at(objective, phi).add_each(range(6), SEARCHED_KINDS)
    assert {each.faults.faults[0].kind for each in every} >= {"bias", "drift", "misplaced"}
    right = next(each.faults for each in every if each.faults.key == {("bias", 2)})
    tested = fit_faults(objective, right, phi)
    assert right.score == pytest.approx(tested.score, abs=15)


@pytest.mark.parametrize(("samples", "told"), [([20], True), ([7, 20, 30], False)])
def test_a_sensor_that_is_alone_has_few_spikes(
    waves: Waves, samples: list[int], told: bool
) -> None:
    """No other sensor contradicts it: many samples off the prediction are the law's fault."""
    recorded = waves.recorded(SIGMA, seed=3)
    recorded[samples, 3] += 1.0
    objective = waves.objective(recorded, SIGMA)
    alone = objective.noise.available.clone()
    alone[:, [j for j in range(alone.shape[1]) if j != 3]] = False
    objective = replace(objective, noise=replace(objective.noise, available=alone))
    _, found, _ = searched(objective)
    assert ("spikes" in {fault.kind for fault in found}) is told
