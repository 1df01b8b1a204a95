"""A least-squares problem of a chosen size, and the pieces of an analysis that work on it.

The system is `ks2d`, the Kuramoto–Sivashinsky equation in two dimensions, with the law
``u_t = … - 0.5 u_x + 0.0001 u²`` of two terms of the library.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from itertools import product

import torch
from torch import Tensor

from dashred.config import load_config
from dashred.data.observation_operator import ObservationOperator
from dashred.data.sensors import Sensor
from dashred.evaluation.performance.measured.setting import (
    COLUMNS,
    MARCH,
    NORMAL_EQUATIONS,
    SELECTION,
    Setting,
)
from dashred.evaluation.performance.measured.waiting_simulator import WaitingSimulator
from dashred.inference.fit.least_squares import LeastSquaresProblem, NormalEquations
from dashred.inference.fit.noise_model import NoiseModel
from dashred.inference.fit.selection.stepwise_moves import promising_sets
from dashred.inference.fit.selection.subset_search import ProfiledProblem
from dashred.inference.forward.candidate_simulator import CandidateSimulator
from dashred.inference.forward.candidates import Candidate
from dashred.inference.forward.episodes import EpisodeStarts, stack_times
from dashred.inference.forward.forward_model import ForwardModel
from dashred.inference.forward.law_block import LawBlock
from dashred.inference.forward.sensor_block import SensorBlock
from dashred.inference.forward.simulator import Simulator
from dashred.physics.runs.ensemble import term_scales
from dashred.physics.runs.initial_state_prior import StartPrior, field_rms, nominal_start
from dashred.physics.system import System, Term
from dashred.physics.terms.library import resolve

# Modes of the start of each episode; time between samples, two time steps.
MODES, EVERY = 16, 0.4
SIGMA = 0.01
# The law, by places in the library.
LAW = {1: -0.5, 4: 1e-4}
FACTORS = ("u", "d(u, x)", "d(u, y)", "lap(u)")
DEGREE = 6
# Dampings of the step that is tried with one Jacobian.
DAMPINGS = (0.0, 0.1, 3.0)


class UnitProblem:
    """The problem, and its pieces by name.

    Attributes:
        system: the system.
        objective: F.
        phi: the point at which F is linearised, ``(unknown,)``.
        pieces: what is timed, by name. Each needs those before it.
    """

    def __init__(self, setting: Setting) -> None:
        words = [f"system.axes.{axis}.points={setting.points}" for axis in "xy"]
        config = load_config(["conf=ks2d", *words, f"system.spread.modes={MODES}"], entry="train")
        self.system = System(config.system, config.where)
        self._generator = torch.Generator().manual_seed(0)
        self.objective = self._objective(setting)
        random = torch.randn(
            (setting.trajectories, self.objective.modes), generator=self._generator
        )
        law = torch.zeros((setting.trajectories, setting.terms), dtype=torch.float64)
        law[:, list(LAW)] = torch.tensor(list(LAW.values()), dtype=torch.float64)
        self._batch = torch.cat([random.double(), law], dim=1)
        self.phi = self._batch[0]
        self.pieces: dict[str, Callable[[], object]] = {
            MARCH: lambda: self.objective.values(self._batch),
            COLUMNS: self._columns,
            NORMAL_EQUATIONS: self._steps,
            SELECTION: self._select,
        }
        self._normal: NormalEquations | None = None

    def warm_up(self) -> None:
        """Compile all code, over two samples."""
        short = self.objective.truncate(2)
        _, trials = short.values(self._batch[:1])
        short.linearise(self.phi, trials.readings[0])
        self._readings = self.objective.values(self._batch[:1])[1].readings[0]

    def waits(self, trajectory: float, column: float) -> None:
        """Let the columns wait instead of computing; arguments in seconds."""
        model = self.objective.forward_model
        waiting = WaitingSimulator(model.simulator, trajectory, column)
        self.objective = replace(self.objective, forward_model=replace(model, simulator=waiting))

    def _columns(self) -> None:
        self._normal = self.objective.linearise(self.phi, self._readings)

    def _unsolved(self) -> NormalEquations:
        """Return the linearised F, without the products that it keeps."""
        assert self._normal is not None
        return replace(self._normal)

    def _steps(self) -> Tensor:
        normal = self._unsolved()
        rows = len(DAMPINGS)
        return normal.steps(
            normal.phi.expand(rows, -1),
            normal.residuals.expand(rows, -1),
            torch.tensor(DAMPINGS, dtype=torch.float64),
            torch.ones((rows, len(normal.phi)), dtype=torch.bool),
        )

    def _select(self) -> list[tuple[int, ...]]:
        normal, modes = self._unsolved(), self.objective.modes
        return promising_sets(ProfiledProblem.from_normal_equations(normal, modes))

    def _objective(self, setting: Setting) -> LeastSquaresProblem:
        system, count = self.system, setting.samples
        nominal = nominal_start(system)
        library = [
            Term("u", system.parse(text, "library", equation="u"))
            for text in library_terms(setting.terms)
        ]
        scales = term_scales(system, library, nominal, 0.0).tolist()
        candidates = [
            Candidate(str(term), term.equation, (ready,), scale)
            for term, ready, scale in zip(library, resolve(system, library), scales, strict=True)
        ]
        part = CandidateSimulator(system, system.dt, candidates)
        prior = StartPrior(system, nominal[0], field_rms(nominal), MODES)
        places = 64 * torch.rand((setting.sensors, 2), generator=self._generator)
        sensors = [Sensor(f"S{i}", "u", (x, y)) for i, (x, y) in enumerate(places.tolist())]
        times = [EVERY * torch.arange(count, dtype=torch.float64)] * setting.episodes
        forward_model = ForwardModel(
            Simulator([part] * setting.episodes),
            EpisodeStarts((prior,) * setting.episodes),
            LawBlock(candidates),
            SensorBlock(ObservationOperator(sensors, system), setting.episodes),
            stack_times(times),
        )
        recorded = torch.randn(
            (count, setting.episodes * setting.sensors), generator=self._generator
        )
        std = torch.full((recorded.shape[1],), SIGMA, dtype=torch.float64)
        noise = NoiseModel(std, torch.zeros_like(std), torch.ones_like(recorded, dtype=torch.bool))
        return LeastSquaresProblem(
            forward_model, recorded.double(), noise, forward_model.law.scales
        )


def library_terms(count: int) -> list[str]:
    """Return the first products of powers of u and its derivatives, by degree."""
    degrees = [each for each in product(range(DEGREE + 1), repeat=len(FACTORS)) if any(each)]
    ordered = sorted(degrees, key=lambda each: (sum(each), [-power for power in each]))
    return ["*".join(_powers(each)) for each in ordered[:count]]


def _powers(degrees: tuple[int, ...]) -> list[str]:
    return [
        factor if degree == 1 else f"({factor})**{degree}"
        for factor, degree in zip(FACTORS, degrees, strict=True)
        if degree
    ]
