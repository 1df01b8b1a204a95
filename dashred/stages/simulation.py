"""Simulate: the established start, the nominal run, the resolution check, the ensemble."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor

from dashred.physics.ensemble import Discrepancies, Ensemble, draw_ensemble
from dashred.physics.library import refuse_collinear
from dashred.physics.prior import StartPrior, field_rms, nominal_start
from dashred.physics.resolution import Resolution, check_resolution
from dashred.physics.simulate import check_finite, simulate
from dashred.physics.system import System
from dashred.progress import stage
from dashred.sensing.observation import ObservationOperator
from dashred.stages.problem import Problem


@dataclass(frozen=True)
class Nominal:
    """The simulator as it is, over the recording's clock.

    Attributes:
        prior: what is known of the start.
        states: the simulation from the nominal start, ``(time, field, *grid)``.
    """

    prior: StartPrior
    states: Tensor


@torch.no_grad()
def simulate_nominal(problem: Problem, seconds: dict[str, float]) -> Nominal:
    """Run the simulator from its own established start.

    Raises:
        InputError: it blows up, or two terms of the library cannot be told apart on it.
    """
    system, times = problem.system, problem.times
    with stage("spin up and simulate", seconds) as report:
        start = nominal_start(system, lambda done: report(0.8 * done, ""))
        path = simulate(system, start, times, progress=lambda done: report(0.8 + 0.2 * done, ""))
        check_finite(path, times, system)
        refuse_collinear(system, problem.library, path[0], float(times[0]))
    modes = system.config.spread.get("modes")
    prior = StartPrior(system, start[0], field_rms(path[0]), None if modes is None else int(modes))
    return Nominal(prior, path[0])


@torch.no_grad()
def check(problem: Problem, nominal: Nominal, seconds: dict[str, float]) -> Resolution:
    """Double the resolution and compare what the recording's sensors would read."""
    every = (*problem.split.fit.sensors, *problem.split.validation.sensors)
    sensors = tuple({sensor.name: sensor for sensor in every}.values())

    def readings(system: System, states: Tensor) -> Tensor:
        return ObservationOperator(sensors, system)(states)

    with stage("check the resolution", seconds) as report:
        coarse = readings(problem.system, nominal.states[None])
        resolution = check_resolution(
            problem.system,
            nominal.states[:1],
            problem.times,
            coarse,
            readings,
            problem.config.resolution_limit,
            lambda done: report(done, ""),
        )
        report(1.0, f"doubling moves a trace by {resolution.error:.2%} of its std")
    return resolution


@torch.no_grad()
def simulate_ensemble(problem: Problem, nominal: Nominal, seconds: dict[str, float]) -> Ensemble:
    """Draw the members that SHRED learns from, over the fit window."""
    settings = problem.config.simulation
    system = problem.ensemble_system
    times = problem.times[: len(problem.split.fit.times)]
    discrepancies = None
    if settings.discrepancy:
        discrepancies = Discrepancies(problem.library, settings.terms, settings.amplitude)
    with stage("simulate the ensemble", seconds) as report:
        ensemble = draw_ensemble(
            system,
            times,
            nominal.prior,
            nominal.states[: len(times)],
            settings.members,
            discrepancies,
            problem.rng("ensemble"),
            lambda done: report(done, ""),
        )
        kind = "with random discrepancies" if settings.discrepancy else "plain"
        report(1.0, f"{settings.members} members, {kind}")
    return ensemble
