"""What discovery minimises, of a posed problem: the simulator, the sensors and their noise."""

from __future__ import annotations

from collections.abc import Sequence

import torch
from torch import Tensor

from dashred.discovery.candidates import Candidate
from dashred.discovery.noise_model import NoiseModel
from dashred.discovery.objective import Objective
from dashred.discovery.shooting import Shooting, Simulator
from dashred.discovery.starts import StartModel
from dashred.physics.resolution import Resolution
from dashred.stages.problem import Problem

# σ is taken for at least this share of a trace's std until residuals tell it: a recording may be
# finer than any law that could be found in it, and a search that believes it gets stuck.
FLOOR = 0.01


def exact_simulator(problem: Problem, candidates: Sequence[Candidate]) -> Simulator:
    """Return the simulator with all candidates in reach; its derivative takes longer steps."""
    return Simulator(problem.system, problem.ensemble_system.dt, candidates)


def rough_simulator(problem: Problem, simulator: Simulator, resolution: Resolution) -> Simulator:
    """Return the simulator that is good enough while the horizon grows.

    With the derivative's longer steps, if their error, of fourth order, stays far below the noise.
    """
    names = problem.split.fit.names
    noise = float((problem.noise_of(names) / trace_std(problem).clamp(min=1e-300)).median())
    longer = simulator.tangent.dt / simulator.system.dt
    return simulator.coarse() if resolution.error * longer**4 < noise / 3 else simulator


def trace_std(problem: Problem) -> Tensor:
    """Return the std of each fit sensor's trace, ``(sensor,)``."""
    return torch.from_numpy(problem.split.fit.trace_std())


def fit_noise(problem: Problem) -> NoiseModel:
    """Return the noise of the fit sensors, as far as it is known before any fit."""
    fit = problem.split.fit
    std = torch.maximum(problem.noise_of(fit.names), FLOOR * trace_std(problem))
    return NoiseModel(std, torch.zeros_like(std), ~torch.isnan(torch.from_numpy(fit.values)))


def pose_objective(
    problem: Problem,
    simulator: Simulator,
    start: StartModel,
    candidates: Sequence[Candidate],
    prior: float,
) -> Objective:
    """Return F over the fit window.

    Args:
        problem: the recording.
        simulator: with at least these candidates in reach.
        start: where it is looked for.
        candidates: what may be missing.
        prior: std of each coefficient, in units of its natural scale (design §4.2.3).
    """
    fit = problem.split.fit
    operator = problem.operator(fit)
    times = problem.times[: len(fit.times)]
    recorded = torch.from_numpy(fit.values)
    scales = torch.tensor([c.scale for c in candidates], dtype=torch.float64)
    shooting = Shooting(simulator, start, candidates, operator, times)
    return Objective(shooting, recorded, fit_noise(problem), prior * scales)
