"""Laws and discoveries for the tests of reports."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import torch

from dashred.config import load_config
from dashred.inference.fit.law import Law, SensorFault
from dashred.inference.fit.noise_model import NoiseModel
from dashred.inference.forward.candidates import Candidate
from dashred.inference.hypotheses.result import BestOfSize, Discovery
from dashred.physics.parameter_sensitivity import parameter_tendency
from dashred.physics.system import System, Term

TEXT = """
system:
  title: Reacting flow
  axes: {x: {length: 2*pi, points: 32}}
  fields: {u: internal energy (J), lam: combustion progress}
  parameters: {nu: 0.1, q: 1.0, alpha: 0.3}
  let: {rate: exp((u - 1)/alpha)}
  equations:
    u: -d(u**2/2, x) + q*rate*(1 - lam) + nu*lap(u)
    lam: rate*(1 - lam) - lam + nu*lap(lam)
  start: {u: 1 + 0.5*sin(x), lam: 0.5}
  spin_up: 1
  integrator: {dt: 0.05}
recording: {twin: a, sensors: 4, noise: 0, duration: 4, every: 0.1}
"""
PENDULUM = """
system:
  title: Pendulum
  fields: {theta: angle (rad), omega: angular velocity (rad/s)}
  parameters: {w2: 64.0}
  equations: {theta: omega, omega: -w2*sin(theta)}
  start: {theta: 1.0, omega: 0.0}
  integrator: {dt: 0.01}
recording: {twin: a, sensors: 1, noise: 0, duration: 4, every: 0.1}
"""
SAMPLES, SENSORS = 40, 3


def declared(folder: Path, text: str = TEXT) -> System:
    """Return a system, declared as a user would."""
    path = folder / "system.yaml"
    path.write_text(text)
    config = load_config([f"conf={path}"], entry="test")
    return System(config.system, config.where)


def term(system: System, equation: str, text: str) -> Candidate:
    """Return a library term as a candidate."""
    expr = system.parse(text, f"library.{equation}", equation=equation)
    ready = Term(equation, system.ready(expr, equation, f"library.{equation}"))
    return Candidate(text, equation, (ready,), 1.0)


def parameter(system: System, name: str, aliases: tuple[str, ...] = ()) -> Candidate:
    """Return a parameter as a candidate."""
    found = parameter_tendency(system, name)
    terms = tuple(Term(equation, expr) for equation, expr in found.items())
    return Candidate(name, None, terms, 1.0, aliases=aliases)


def law(
    candidates: Sequence[Candidate] = (),
    values: Sequence[float] = (),
    std: float = 0.001,
    score: float = 0.0,
    misfit: float = 1.0,
    chi2: float = 1.0,
    edges: tuple[float, ...] = (),
    faults: Sequence[SensorFault] = (),
    widened: float = 1.0,
) -> Law:
    """Return a law whose residuals are all ``misfit``."""
    return Law(
        candidates=tuple(candidates),
        coefficients=torch.tensor(values, dtype=torch.float64),
        covariance=std**2 * torch.eye(len(candidates), dtype=torch.float64),
        start=torch.zeros(1, dtype=torch.float64),
        score=score,
        chi2=chi2,
        residuals=torch.full((SAMPLES, SENSORS), misfit, dtype=torch.float64),
        edges=edges,
        faults=tuple(faults),
        start_prior_factor=widened,
    )


def discovery(
    *laws: Law,
    uncorrected: Law | None = None,
    is_horizon_complete: bool = True,
    free_chi2: float = 1.0,
    is_search_complete: bool = True,
    seen: torch.Tensor | None = None,
    forcing_gain: float = 0.0,
    path: list[BestOfSize] | None = None,
) -> Discovery:
    """Return a discovery with these laws, the best first, under noise of σ = 1."""
    everywhere = torch.ones(SAMPLES, SENSORS, dtype=torch.bool)
    noise = NoiseModel(
        torch.ones(SENSORS, dtype=torch.float64),
        torch.zeros(SENSORS, dtype=torch.float64),
        everywhere if seen is None else seen,
    )
    return Discovery(
        laws=list(laws),
        uncorrected=uncorrected or law(score=1000.0, misfit=3.0, chi2=9.0),
        noise=noise,
        first_guesses={"prior": 1.0},
        first_guess="prior",
        levels=[(10, 1.0), (SAMPLES, 1.1)],
        is_horizon_complete=is_horizon_complete,
        free_chi2=free_chi2,
        is_search_complete=is_search_complete,
        path=path or [BestOfSize((), (), 1000.0, 3.0)],
        refit_count=50,
        forcing_gain=forcing_gain,
    )
