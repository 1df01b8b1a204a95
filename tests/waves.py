"""Two coupled nonlinear fields on a periodic axis; the sensors read the first."""

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
from dashred.inference.fit.fitted_law import build_law
from dashred.inference.fit.least_squares import LeastSquaresProblem
from dashred.inference.fit.levenberg_marquardt import minimise, minimise_growing_horizon
from dashred.inference.fit.noise_model import NoiseModel
from dashred.inference.forward.candidate_simulator import CandidateSimulator
from dashred.inference.forward.candidates import Candidate, build_candidates, build_forcing
from dashred.inference.forward.episodes import EpisodeStarts, stack_times
from dashred.inference.forward.forward_model import ForwardModel
from dashred.inference.forward.law_block import LawBlock, restrict_to_window
from dashred.inference.forward.sensor_block import SensorBlock
from dashred.inference.forward.simulator import Simulator
from dashred.inference.hypotheses.extended.extended_library import build_extended_candidates
from dashred.inference.hypotheses.hypothesis_fit import HypothesisFit
from dashred.inference.hypotheses.windows.windowed_hypothesis import (
    Hypothesis,
    WindowGuess,
    build_problem,
    first_unknowns,
)
from dashred.inference.initial_state.start_models import StartModel
from dashred.physics.runs.initial_state_prior import StartPrior, field_rms, nominal_start
from dashred.physics.solvers.simulate import simulate
from dashred.physics.system import System, Term
from dashred.physics.terms.library import evaluate_terms
from dashred.physics.window import Shape, window_shapes
from tests import laws

TEXT = """
system:
  title: two fields on a ring
  axes: {x: {length: 10, points: 32}}
  fields: {u: first, v: second}
  equations:
    u: u - u**3/3 - v + 0.5 - 0.6*d(u, x) + 0.2*lap(u)
    v: 0.3*(u + 0.7 - 0.8*v) + 0.1*lap(v)
  start: {u: cos(2*pi*x/10), v: 0.5*sin(2*pi*x/10)}
  spread: {u: 0.2, v: 0.2, length: 3}
  integrator: {dt: 0.1}
recording: {twin: a, sensors: 4, noise: 0, duration: 4, every: 0.1}
"""
TERMS = (("u", "u"), ("u", "u**2"), ("u", "v**2"), ("u", "u**3"), ("v", "v**2"), ("v", "u*v"),
         ("u", "1"), ("v", "1"), ("u", "d(u, x)"))  # fmt: skip
LOCAL_SIGMA, LOCAL_XI = 0.01, -0.4
TIMES = 0.25 * torch.arange(41, dtype=torch.float64)


@dataclass(frozen=True)
class Waves:
    """The compiled waves, with all kinds of windows."""

    system: System
    simulator: Simulator
    everything: dict[str, Candidate]

    @classmethod
    def declared(cls, folder: Path) -> Waves:
        """Return the waves with all candidates."""
        system = laws.declared(folder, TEXT)
        states = simulate(system, nominal_start(system), TIMES)[0]
        library = [Term(e, system.parse(text, "library", equation=e)) for e, text in TERMS]
        everything = build_candidates(system, library, states, 0.0)
        part = CandidateSimulator(system, system.dt, everything, window_shapes(system))
        return cls(system, Simulator([part]), {str(found): found for found in everything})

    def simulated(self) -> Tensor:
        """Return the simulator's own run, ``(time, field, *grid)``."""
        return simulate(self.system, nominal_start(self.system), TIMES)[0]

    @cached_property
    def extended(self) -> list[Candidate]:
        """Candidates that the library does not have."""
        states = self.simulated()
        library = [Term(e, self.system.parse(t, "library", equation=e)) for e, t in TERMS]
        return build_extended_candidates(self.system, library, states, 0.0)

    @cached_property
    def operator(self) -> ObservationOperator:
        """Observation operator of u at six positions off the grid."""
        places = [0.3 + 10 / 6 * j + 0.2 * math.sin(5.0 * j) for j in range(6)]
        sensors = [Sensor(f"s{j}", "u", (x,)) for j, x in enumerate(places)]
        return ObservationOperator(sensors, self.system)

    @cached_property
    def start(self) -> StartModel:
        """Prior around the nominal start."""
        nominal = nominal_start(self.system)
        return EpisodeStarts((StartPrior(self.system, nominal[0], field_rms(nominal), None),))

    def candidates(self, names: Sequence[str]) -> list[Candidate]:
        """Return candidates by name, ``equation: term``."""
        return [self.everything[name] for name in names]

    def noise(self, recorded: Tensor, sigma: float) -> NoiseModel:
        """Return white noise of the same size at every sensor."""
        std = torch.full((recorded.shape[1],), sigma, dtype=torch.float64)
        return NoiseModel(std, torch.zeros_like(std), ~recorded.isnan())

    def objective(
        self, recorded: Tensor, sigma: float, names: Sequence[str] = ()
    ) -> LeastSquaresProblem:
        """Return F with candidates by name; their prior is their natural scale."""
        forward_model = self.forward_model(LawBlock(self.candidates(names)))
        noise = self.noise(recorded, sigma)
        return LeastSquaresProblem(forward_model, recorded, noise, forward_model.law.scales)

    def forward_model(self, law: LawBlock, times: Tensor = TIMES) -> ForwardModel:
        """Return the forward model of a law."""
        sensors = SensorBlock(self.operator)
        return ForwardModel(self.simulator, self.start, law, sensors, stack_times([times]))

    def recorded(
        self,
        sigma: float,
        seed: int,
        law: Sequence[tuple[Candidate, float]] = (),
        start: StartModel | None = None,
    ) -> Tensor:
        """Return noisy readings under a law, from a start drawn from the prior, or another."""
        drawn = start or self.start
        generator = torch.Generator().manual_seed(seed)
        z = torch.randn((1, drawn.size), generator=generator).double()
        forcing = build_forcing(
            [candidate for candidate, _ in law],
            torch.tensor([[value for _, value in law]], dtype=torch.float64),
        )
        [begin] = drawn.start(z)
        clean = self.operator(simulate(self.system, begin, TIMES, forcing))[0]
        return clean + sigma * torch.randn(clean.shape, generator=generator).double()

    @cached_property
    def size(self) -> Tensor:
        """Rms of each equation's own tendency over the nominal simulation."""
        states = self.simulated()
        own = [Term(field, self.system.equations[field]) for field in self.system.fields]
        return evaluate_terms(self.system, own, states, 0.0).flatten(1).square().mean(dim=1).sqrt()


def fitted(objective: LeastSquaresProblem) -> Tensor:
    """Return the minimum of an F of the start alone, grown from its first samples."""
    begin = torch.zeros(objective.modes, dtype=torch.float64)
    return minimise(objective, minimise_growing_horizon(objective, begin, 6), 8, 1e-4).phi


def in_window(
    waves: Waves,
    shape: Shape,
    values: tuple[float, ...],
    guess: tuple[float, ...] | None = None,
) -> HypothesisFit:
    """Return the fit of a term in a window to a recording of that, from the truth or a guess."""
    hidden = restrict_to_window(waves.candidates(["u: v**2"]), shape.at(values))
    recorded = waves.recorded(LOCAL_SIGMA, 4, [(hidden[0], LOCAL_XI)])
    objective = waves.objective(recorded, LOCAL_SIGMA, ["u: v**2"])
    spread = [0.8] * (len(values) - 1)
    hypothesis = Hypothesis((), (0,), WindowGuess(shape, guess or values, (*spread, 1.0)))
    mine = build_problem(objective, hypothesis)
    z = fitted(waves.objective(recorded, LOCAL_SIGMA))
    found = minimise(mine, first_unknowns(z, [LOCAL_XI], hypothesis.guess), 12, 1e-6)
    return HypothesisFit(build_law(mine, found, found.cost), mine, found.phi)
