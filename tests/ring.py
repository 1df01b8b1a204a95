"""A linear wave on a periodic axis with sensors, an ensemble and an untrained SHRED."""

from __future__ import annotations

from pathlib import Path

import torch
from torch import Tensor

from dashred.config import load_config
from dashred.data.observation_operator import ObservationOperator
from dashred.data.recording import Recording
from dashred.data.sensors import Sensor
from dashred.models.pod import POD
from dashred.models.scaler import Scaler
from dashred.models.shred import SHRED
from dashred.physics.runs.ensemble import Ensemble
from dashred.physics.runs.stored_states import States
from dashred.physics.solvers.simulate import simulate
from dashred.physics.system import System, Term

TEXT = """
system:
  title: advection, diffusion and decay
  axes: {x: {length: 2*pi, points: 32}}
  fields: {u: height}
  parameters: {c: 1.0, nu: 0.03, r: 0.1}
  equations: {u: "-c*d(u, x) + nu*lap(u) - r*u"}
  start: {u: sin(x)}
  integrator: {dt: 0.05}
recording: {twin: a, sensors: 6, noise: 0, duration: 4, every: 0.1}
latent_sindy: {steps: [1, 3], begins: 6, bootstraps: 3}
"""
LIBRARY = ("1", "u", "u**2", "u**3", "d(u, x)", "d(u, x, 2)", "d(u, x, 3)", "u*d(u, x)")
TIMES = 0.1 * torch.arange(41, dtype=torch.float64)
SENSORS = tuple(Sensor(f"s{i}", "u", (x,)) for i, x in enumerate((0.2, 1.3, 2.1, 3.5, 4.4, 5.9)))


def linear_system(folder: Path) -> System:
    """Return ``u_t = -c u_x + ν u_xx - r u``, declared as a user would."""
    path = folder / "ring.yaml"
    path.write_text(TEXT)
    config = load_config([f"conf={path}"], entry="test")
    return System(config.system, config.where)


def library(system: System) -> list[Term]:
    """Return eight candidate terms."""
    return [Term("u", system.parse(text, "library.u", equation="u")) for text in LIBRARY]


def starts(system: System, members: int, seed: int) -> Tensor:
    """Return smooth random starts ``(member, field, x)``."""
    generator = torch.Generator().manual_seed(seed)
    x = system.grid.coordinates["x"]
    found = torch.full((members, 1, len(x)), 0.5, dtype=torch.float64)
    for k in (1, 2, 3):
        for wave in (torch.sin(k * x), torch.cos(k * x)):
            size = torch.randn(members, 1, 1, generator=generator, dtype=torch.float64)
            found = found + size / k * wave
    return found


def ensemble(system: System, members: int, seed: int = 0) -> Ensemble:
    """Return simulations from random starts."""
    states = simulate(system, starts(system, members, seed), TIMES)
    return Ensemble(TIMES, states, torch.zeros(members, 0, dtype=torch.float64))


def untrained(states: States, operator: ObservationOperator, seed: int = 0) -> SHRED:
    """Return a random SHRED in float64 with the scales of ``(member, time, field, x)``."""
    assert isinstance(states, Tensor)
    torch.manual_seed(seed)
    pod = POD.fit(states.flatten(0, 1), 6)
    spread = pod.encode(states).flatten(0, 1).std(dim=0)
    return SHRED(Scaler.fit(operator(states)), pod, spread, 24, 1, [16]).double()


def record(system: System, states: Tensor, sensors: tuple[Sensor, ...] = SENSORS) -> Recording:
    """Return the noise-free sensor values of ``(time, field, x)``."""
    values = ObservationOperator(sensors, system)(states).numpy()
    return Recording(sensors, TIMES[: len(states)].numpy(), values)
