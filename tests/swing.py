"""A compiled swing with its sensors, candidates and least-squares problem, for fast fits.

The swing is linear except for its candidates. With forces that depend on time only, the readings
are linear in all unknowns.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import torch
from torch import Tensor

from dashred.data.observation_operator import ObservationOperator
from dashred.data.sensors import Sensor
from dashred.inference.fit.least_squares import LeastSquaresProblem
from dashred.inference.fit.noise_model import NoiseModel
from dashred.inference.forward.candidate_simulator import CandidateSimulator
from dashred.inference.forward.candidates import Candidate
from dashred.inference.forward.episodes import EpisodeStarts, stack_times
from dashred.inference.forward.forward_model import ForwardModel
from dashred.inference.forward.law_block import LawBlock
from dashred.inference.forward.sensor_block import SensorBlock
from dashred.inference.forward.simulator import Simulator
from dashred.inference.initial_state.start_models import LinearStart
from dashred.physics.solvers.simulate import simulate
from dashred.physics.system import System, Term
from tests import laws

TEXT = """
system:
  title: a swing
  fields: {x: place, p: momentum}
  parameters: {k: 2.0, c: 0.05}
  equations: {x: p, p: -k*x - c*p}
  start: {x: 1, p: 0}
  integrator: {method: rk4, dt: 0.05}
recording: {twin: a, sensors: 2, noise: 0, duration: 12, every: 0.1}
"""
# Terms of the momentum equation.
FORCES = ("x**2", "x**3", "p**3", "abs(p)*p", "sign(p)", "x*p", "sin(3*x)", "1")
# Terms in time only: the readings are linear in all unknowns.
DRIVES = ("1", "t", "sin(t)", "cos(2*t)")
SENSORS = (Sensor("place", "x"), Sensor("momentum", "p"))
TIMES = 0.15 * torch.arange(81, dtype=torch.float64)
# Prior of the start: the truth is drawn from it, or lies well within.
MEAN, SPREAD = (0.9, 0.2), 0.3


@dataclass(frozen=True)
class Swing:
    """The compiled swing."""

    system: System
    simulator: Simulator
    everything: dict[str, Candidate]

    @classmethod
    def declared(cls, folder: Path) -> Swing:
        """Return the system with all candidates."""
        system = laws.declared(folder, TEXT)
        terms = [laws.term(system, "p", text) for text in dict.fromkeys((*FORCES, *DRIVES))]
        parameters = [laws.parameter(system, name) for name in system.config.parameters]
        everything = [*parameters, *terms]
        simulator = Simulator([CandidateSimulator(system, system.dt, everything)])
        return cls(system, simulator, {found.name: found for found in everything})

    @cached_property
    def operator(self) -> ObservationOperator:
        """Observation operator of position and momentum."""
        return ObservationOperator(SENSORS, self.system)

    @cached_property
    def estimate(self) -> LinearStart:
        """The start of one episode: ``m + 0.3 z``."""
        mean = torch.tensor(MEAN, dtype=torch.float64)
        return LinearStart(mean, SPREAD * torch.eye(2, dtype=torch.float64))

    @cached_property
    def start(self) -> EpisodeStarts:
        """Where the start is looked for."""
        return EpisodeStarts((self.estimate,))

    def forward_model(self, names: Sequence[str]) -> ForwardModel:
        """Return the forward model with candidates by name."""
        law = LawBlock([self.everything[name] for name in names])
        sensors = SensorBlock(self.operator)
        return ForwardModel(self.simulator, self.start, law, sensors, stack_times([TIMES]))

    def clean(self, z: Sequence[float], names: Sequence[str], xi: Sequence[float]) -> Tensor:
        """Return what the sensors would read without noise, ``(time, sensor)``."""
        unknowns = (torch.tensor([u], dtype=torch.float64) for u in (z, xi))
        return self.forward_model(names).readings(*unknowns)[0]

    def foreign(self, z: Sequence[float], text: str, value: float) -> Tensor:
        """Return readings with a force that is not a candidate."""
        term = Term("p", self.system.parse(text, "test", equation="p"))
        other = self.system.with_terms([(term, value)])
        [start] = self.start.start(torch.tensor([z], dtype=torch.float64))
        return self.operator(simulate(other, start, TIMES))[0]

    def objective(
        self, names: Sequence[str], recorded: Tensor, sigma: float, prior: Sequence[float] | float
    ) -> LeastSquaresProblem:
        """Return F with candidates by name."""
        std = torch.full((len(SENSORS),), sigma, dtype=torch.float64)
        noise = NoiseModel(std, torch.zeros_like(std), ~recorded.isnan())
        stds = torch.as_tensor(prior, dtype=torch.float64).expand(len(names)).clone()
        return LeastSquaresProblem(self.forward_model(names), recorded, noise, stds)


def noisy(values: Tensor, sigma: float, seed: int) -> Tensor:
    """Return values with white noise."""
    generator = torch.Generator().manual_seed(seed)
    return values + sigma * torch.randn(values.shape, generator=generator, dtype=torch.float64)


def line(objective: LeastSquaresProblem) -> tuple[Tensor, Tensor]:
    """Return A and b of whitened residuals ``A φ - b``, by runs along every unknown."""
    count = objective.modes + len(objective.prior_std)
    unknowns = torch.cat([torch.zeros(1, count), torch.eye(count)]).double()
    readings = objective.forward_model.readings(*objective.split(unknowns))
    columns = objective.noise.whiten(readings[1:] - readings[0]).flatten(1).T
    return columns, -objective.residuals(readings[0])


def ridge(objective: LeastSquaresProblem, members: Sequence[int]) -> tuple[Tensor, float, Tensor]:
    """Return the exact φ, F and covariance where readings are linear in φ, by plain algebra."""
    columns, target = line(objective)
    index = [*range(objective.modes), *(objective.modes + j for j in members)]
    stds = torch.cat([torch.ones(objective.modes).double(), objective.prior_std])
    a, p = columns[:, index], torch.diag(stds[index] ** -2)
    covariance = torch.linalg.inv(a.T @ a + p)
    best = covariance @ (a.T @ target)
    cost = float((a @ best - target).square().sum() + best @ p @ best)
    phi = torch.zeros(len(stds), dtype=torch.float64)
    phi[index] = best
    return phi, cost, covariance
