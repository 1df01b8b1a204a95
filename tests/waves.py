"""Two coupled fields on a ring, of which sensors read the first: small, nonlinear and resolved."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import torch
from torch import Tensor

from dashred.discovery.candidates import Candidate
from dashred.discovery.noise_model import NoiseModel
from dashred.discovery.shooting import Simulator
from dashred.discovery.starts import StartModel
from dashred.physics.prior import StartPrior, field_rms, nominal_start
from dashred.physics.system import System
from dashred.physics.window import shapes_of
from dashred.sensing.observation import ObservationOperator
from dashred.sensing.sensors import Sensor
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
TIMES = 0.25 * torch.arange(41, dtype=torch.float64)


@dataclass(frozen=True)
class Waves:
    """The compiled waves, with every kind of window in reach."""

    system: System
    simulator: Simulator
    everything: dict[str, Candidate]

    @classmethod
    def declared(cls, folder: Path) -> Waves:
        """Return them with all candidates in reach."""
        system = laws.declared(folder, TEXT)
        everything = [laws.term(system, equation, text) for equation, text in TERMS]
        simulator = Simulator(system, system.dt, everything, shapes_of(system))
        return cls(system, simulator, {str(found): found for found in everything})

    @cached_property
    def operator(self) -> ObservationOperator:
        """Reads u at six places off the grid."""
        places = [0.3 + 10 / 6 * j + 0.2 * math.sin(5.0 * j) for j in range(6)]
        sensors = [Sensor(f"s{j}", "u", (x,)) for j, x in enumerate(places)]
        return ObservationOperator(sensors, self.system)

    @cached_property
    def start(self) -> StartModel:
        """The prior about the nominal start."""
        nominal = nominal_start(self.system)
        return StartPrior(self.system, nominal[0], field_rms(nominal), None)

    def candidates(self, names: Sequence[str]) -> list[Candidate]:
        """Return candidates by name, ``equation: term``."""
        return [self.everything[name] for name in names]

    def noise(self, recorded: Tensor, sigma: float) -> NoiseModel:
        """Return white noise of the same size at every sensor."""
        std = torch.full((recorded.shape[1],), sigma, dtype=torch.float64)
        return NoiseModel(std, torch.zeros_like(std), ~recorded.isnan())
