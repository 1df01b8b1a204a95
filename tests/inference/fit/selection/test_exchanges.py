"""Terms that are equal where the problem is linearised first are told apart by exchanges."""

from __future__ import annotations

import pytest
import torch
from torch import Tensor

from dashred.data.observation_operator import ObservationOperator
from dashred.data.sensors import Sensor
from dashred.inference.fit.least_squares import LeastSquaresProblem
from dashred.inference.fit.noise_model import NoiseModel
from dashred.inference.fit.selection.stepwise_moves import Set, exchanges
from dashred.inference.fit.selection.stepwise_selection import Selection, select
from dashred.inference.fit.selection.subset_search import ProfiledProblem
from dashred.inference.forward.candidate_simulator import CandidateSimulator
from dashred.inference.forward.candidates import Candidate, build_candidates
from dashred.inference.forward.episodes import EpisodeStarts, stack_times
from dashred.inference.forward.forward_model import ForwardModel
from dashred.inference.forward.law_block import LawBlock
from dashred.inference.forward.sensor_block import SensorBlock
from dashred.inference.forward.simulator import Simulator
from dashred.inference.initial_state.start_models import LinearStart
from dashred.physics.solvers.simulate import simulate
from dashred.physics.system import System
from dashred.physics.terms.library import build_library
from tests import laws
from tests.swing import noisy

# Without the reaction both species are always equal.
SPECIES = """
system:
  title: two species
  fields: {a: first, b: second}
  equations: {a: 0.3 - 0.3*a, b: 0.3 - 0.3*b}
  start: {a: 2, b: 2}
  integrator: {method: rk4, dt: 0.1}
recording: {twin: a, sensors: 2, noise: 0, duration: 6, every: 0.1}
"""
CUBES = ["a**3", "b*a**2", "a*b**2", "b**3"]
TIMES = 0.1 * torch.arange(61, dtype=torch.float64)
SIGMA, SPREAD = 0.002, 0.02
TRUTH: dict[str, float] = {"a: a*b**2": -0.1, "b: a*b**2": -0.2}


@pytest.fixture(scope="module")
def species(tmp_path_factory: pytest.TempPathFactory) -> System:
    return laws.declared(tmp_path_factory.mktemp("species"), SPECIES)


def candidates(system: System, moved: bool = True) -> list[Candidate]:
    """Return the cubic terms, compared on the simulation, and on other states."""
    library = build_library(system, {"a": CUBES, "b": CUBES})
    begin = torch.tensor([[2.0, 2.0]], dtype=torch.float64)
    states = simulate(system, begin, TIMES)[0]
    generator = torch.Generator().manual_seed(0)
    noise = SPREAD * torch.randn(states.shape, generator=generator, dtype=torch.float64)
    return build_candidates(system, library, states, 0.0, moved=states + noise if moved else None)


def problem(system: System) -> LeastSquaresProblem:
    """Return F of all candidates on a recording of the truth."""
    found = candidates(system)
    operator = ObservationOperator((Sensor("one", "a"), Sensor("other", "b")), system)
    simulator = Simulator([CandidateSimulator(system, system.dt, found)])
    mean = torch.tensor([2.0, 2.0], dtype=torch.float64)
    start = EpisodeStarts((LinearStart(mean, SPREAD * torch.eye(2, dtype=torch.float64)),))
    law = LawBlock(found)
    model = ForwardModel(simulator, start, law, SensorBlock(operator), stack_times([TIMES]))
    xi = torch.tensor([[TRUTH.get(str(each), 0.0) for each in found]], dtype=torch.float64)
    z = torch.tensor([[0.3, -0.4]], dtype=torch.float64)
    recorded = noisy(model.readings(z, xi)[0], SIGMA, 0)
    std = torch.full((2,), SIGMA, dtype=torch.float64)
    noise = NoiseModel(std, torch.zeros_like(std), ~recorded.isnan())
    return LeastSquaresProblem(model, recorded, noise, law.scales)


def test_terms_that_are_equal_in_the_simulation_alone_are_candidates(species: System) -> None:
    """Also those in which the same two fields occur with other powers."""
    expected = [f"{equation}: {text}" for equation in "ab" for text in CUBES]
    assert [str(each) for each in candidates(species)] == expected
    alone = [str(each) for each in candidates(species, moved=False)]
    assert alone == ["a: a**3", "b: a**3"]


def test_exchanges_have_nearly_the_same_effect_given_the_rest() -> None:
    generator = torch.Generator().manual_seed(0)
    columns = torch.randn(40, 5, generator=generator, dtype=torch.float64)
    columns[:, 2] = -3 * (columns[:, 0] + 0.05 * columns[:, 2])
    # What it has in common with another member does not make it another candidate.
    columns[:, 3] = columns[:, 1] + 0.3 * columns[:, 4]
    columns[:, 4] = columns[:, 1]
    found = profiled(columns)
    assert exchanges(found, (0,)) == [(2,)]
    assert exchanges(found, (0, 1)) == [(1, 2), (0, 4)]
    assert exchanges(found, (1, 3)) == [(3, 4)]
    assert exchanges(found, ()) == []


def profiled(columns: Tensor) -> ProfiledProblem:
    count = columns.shape[1]
    zero, ones = torch.zeros(count).double(), torch.ones(count).double()
    return ProfiledProblem(columns.T @ columns, zero, 1.0, ones)


@pytest.fixture
def _exchanges_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    """Refit only the empty set, the proposals, and exchanges."""
    moves = "dashred.inference.fit.selection.stepwise_moves"
    monkeypatch.setattr(f"{moves}.REFITTED", {})
    monkeypatch.setattr(f"{moves}.LARGEST_ON_PATH", 0)
    monkeypatch.setattr(f"{moves}.NEIGHBOURS", 0)


@pytest.mark.usefixtures("_exchanges_alone")
def test_exchanges_find_the_true_terms(species: System, monkeypatch: pytest.MonkeyPatch) -> None:
    """The search begins at the simulation, where all cubic terms have the same effect."""
    objective = problem(species)
    names = [str(each) for each in objective.forward_model.law.candidates]
    truth = tuple(names.index(name) for name in TRUTH)
    wrong: Set = (names.index("a: a**3"), names.index("b: a**3"))

    def searched() -> Selection:
        zero = torch.zeros(objective.modes + len(names), dtype=torch.float64)
        return select(objective, zero, [wrong], lambda *_: None)

    found = searched()
    assert found.tried[0].members == truth and found.exhausted
    xi = found.tried[0].phi[objective.modes :][list(truth)]
    torch.testing.assert_close(xi, torch.tensor([*TRUTH.values()]).double(), rtol=0.1, atol=0)
    assert found.tried[0].score < min(t.score for t in found.tried if t.members == wrong) - 40
    monkeypatch.setattr("dashred.inference.fit.selection.stepwise_moves.ALIKE", 2.0)
    assert searched().tried[0].members == wrong
