"""A tracer in a ring channel: a linear system, with hidden sources."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import torch
from torch import Tensor

from dashred.data.observation_operator import ObservationOperator
from dashred.data.sensors import Sensor
from dashred.inference.fit.least_squares import LeastSquaresProblem
from dashred.inference.fit.levenberg_marquardt import minimise
from dashred.inference.fit.noise_model import NoiseModel
from dashred.inference.forward.candidate_simulator import CandidateSimulator
from dashred.inference.forward.candidates import Candidate, build_candidates, build_forcing
from dashred.inference.forward.episodes import EpisodeStarts, stack_times
from dashred.inference.forward.forward_model import ForwardModel
from dashred.inference.forward.law_block import LawBlock
from dashred.inference.forward.sensor_block import SensorBlock
from dashred.inference.forward.simulator import Simulator
from dashred.inference.initial_state.start_models import StartModel
from dashred.physics.runs.initial_state_prior import StartPrior, field_rms, nominal_start
from dashred.physics.solvers.simulate import simulate
from dashred.physics.system import System, Term
from dashred.physics.terms.library import evaluate_terms
from tests import laws

LENGTH, SIGMA = 10.0, 0.004
TEXT = """
system:
  title: a channel
  axes: {x: {length: 10, points: 48}}
  fields: {c: concentration}
  equations: {c: "-0.5*d(c, x) + 0.08*lap(c) - 0.1*c"}
  start: {c: 0.5 + 0.3*cos(2*pi*x/10)}
  spread: {c: 0.1, length: 2}
  integrator: {dt: 0.05}
recording: {twin: a, sensors: 4, noise: 0, duration: 4, every: 0.1}
"""
TIMES = 0.1 * torch.arange(81, dtype=torch.float64)


@dataclass(frozen=True)
class Channel:
    """The compiled channel, with its library."""

    system: System
    simulator: Simulator
    library: list[Candidate]

    @classmethod
    def declared(cls, folder: Path) -> Channel:
        """Return the channel."""
        system = laws.declared(folder, TEXT)
        states = simulate(system, nominal_start(system), TIMES)[0]
        texts = ("1", "c", "c**2", "d(c, x, 3)")
        terms = [Term("c", system.parse(text, "library", equation="c")) for text in texts]
        library = build_candidates(system, terms, states, 0.0)
        return cls(system, Simulator([CandidateSimulator(system, 0.05, library)]), library)

    @cached_property
    def operator(self) -> ObservationOperator:
        """Observation operator of twelve positions off the grid."""
        places = [0.3 + LENGTH / 12 * j + 0.2 * math.sin(5.0 * j) for j in range(12)]
        return ObservationOperator([Sensor(f"s{j}", "c", (x,)) for j, x in enumerate(places)],
                                   self.system)  # fmt: skip

    @cached_property
    def start(self) -> StartModel:
        """Prior around the nominal start."""
        nominal = nominal_start(self.system)
        return EpisodeStarts((StartPrior(self.system, nominal[0], field_rms(nominal), 12),))

    @cached_property
    def size(self) -> Tensor:
        """Rms of the tendency over the nominal simulation, ``(1,)``."""
        states = simulate(self.system, nominal_start(self.system), TIMES)[0]
        own = [Term("c", self.system.equations["c"])]
        return evaluate_terms(self.system, own, states, 0.0).flatten(1).square().mean(dim=1).sqrt()

    def recorded(self, hidden: Sequence[tuple[str, float]] = (), seed: int = 0) -> Tensor:
        """Return noisy readings under hidden terms in the equation language."""
        terms = [laws.term(self.system, "c", text) for text, _ in hidden]
        values = torch.tensor([[value for _, value in hidden]], dtype=torch.float64)
        generator = torch.Generator().manual_seed(seed)
        z = torch.randn((1, self.start.size), generator=generator).double()
        [begin] = self.start.start(z)
        clean = self.operator(simulate(self.system, begin, TIMES, build_forcing(terms, values)))[0]
        return clean + SIGMA * torch.randn(clean.shape, generator=generator).double()

    def objective(
        self, recorded: Tensor, candidates: Sequence[Candidate] = ()
    ) -> LeastSquaresProblem:
        """Return F of some candidates; their prior is their natural scale."""
        std = torch.full((recorded.shape[1],), SIGMA, dtype=torch.float64)
        noise = NoiseModel(std, torch.zeros_like(std), ~recorded.isnan())
        law, sensors = LawBlock(candidates), SensorBlock(self.operator)
        model = ForwardModel(self.simulator, self.start, law, sensors, stack_times([TIMES]))
        return LeastSquaresProblem(model, recorded, noise, law.scales)


def fitted(objective: LeastSquaresProblem) -> Tensor:
    """Return the minimum of F of the start alone."""
    return minimise(objective, torch.zeros(objective.modes, dtype=torch.float64), 4, 1e-3).phi
