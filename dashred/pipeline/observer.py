"""The observer: the state of the recording in real time, with the corrected simulator.

See docs/method.md#observer.
"""

from __future__ import annotations

import math

import numpy as np
import torch
from torch import Tensor

from dashred.core.progress import stage
from dashred.inference.fit.law import Law
from dashred.inference.forward.candidates import build_forcing
from dashred.inference.observer.localisation import radius_for, sensor_tapers
from dashred.inference.observer.march import March
from dashred.inference.observer.observe import observe
from dashred.inference.observer.observed_record import ObservedRecord
from dashred.physics.runs.initial_state_prior import StartPrior
from dashred.physics.runs.uncertain_terms import UncertainTerms
from dashred.physics.system import System
from dashred.pipeline.corrected_ensemble import EpisodeEnsemble, simulate_corrected
from dashred.pipeline.problem import Problem
from dashred.pipeline.simulation.nominal_run import NominalRun
from dashred.pipeline.trajectories import Trajectories

STAGE = "observe"
# Key in run.json of the time that one step of the observer takes, for one recording.
STEP = "one step of the observer"
# Simulations for each sensor, as far as they and their values are not more than this: 128 MiB.
PER_SENSOR, MOST, MOST_VALUES = 16, 512, 2**24


def observe_episodes(
    problem: Problem,
    nominal: NominalRun,
    law: Law,
    free: Trajectories,
    seconds: dict[str, float],
) -> list[tuple[Tensor, Tensor]]:
    """Observe the fit sensors of every episode.

    The simulations start as the simulator may start before any reading. The fitted start is not
    used, because it comes from later readings.

    Args:
        problem: simulator and recording.
        nominal: simulation with the prior of the start.
        law: correction of the simulator. Its faulty sensors are not read.
        free: free runs; the corrected one limits the range of the simulations.
        seconds: run time by stage, updated.

    Returns:
        The estimate of each episode and its standard deviation, ``(time, field, *grid)`` both.
        Empty for a program, whose steps would take too long, if there is an episode without
        simulations, and if these or the estimates do not stay within bounds.

    Raises:
        OutOfTimeError: there was no time for it.
    """
    if problem.system.program is not None:
        return []
    prior = nominal.prior

    def before_readings(system: System, index: int) -> StartPrior:
        return StartPrior(system, prior.centre, prior.rms, prior.kept)

    members = _simulations(problem)
    drawn = simulate_corrected(
        problem,
        law,
        free,
        before_readings,
        1.0,
        members,
        "simulate for the observer",
        seconds,
        _uncertainty(law),
    )
    if drawn is None or len(drawn) < len(problem.episodes):
        return []
    with stage(STAGE, seconds) as report:
        records = [_record(each, law, members) for each in drawn]
        seed = [problem.config.seed, *STAGE.encode()]
        found = observe(records, seed, problem.deadline(STAGE))
        if not all(np.isfinite(each.states).all() for each in found):
            report(1.0, "the estimates blow up")
            return []
        states = found[0].states[: 1 + found[0].perturbations]
        seconds[STEP] = records[0].seconds_per_step(states, found[0].march)
        model_error = found[0].model_error
        told = f"{members} simulations"
        if model_error:
            told += f", error of the simulator in a sample {model_error:g}"
        report(1.0, told)
    return [
        (record.march.on_grid(each.states), record.march.on_grid(each.spread))
        for record, each in zip(records, found, strict=True)
    ]


def _simulations(problem: Problem) -> int:
    """Return the number of simulations of all episodes."""
    fit, system = problem.split.fit, problem.system
    values = len(fit.times) * len(system.fields) * math.prod(system.grid.shape)
    affordable = min(MOST, MOST_VALUES // values, PER_SENSOR * len(fit.names))
    return max(problem.config.surrogate.members, affordable)


def _uncertainty(law: Law) -> UncertainTerms | None:
    """Return the uncertainty of the law and of uncertain parameters; None if there are none."""
    candidates, _ = law.changes
    if not candidates:
        return None
    forcing = build_forcing(candidates, torch.eye(len(candidates), dtype=torch.float64))
    stds = torch.tensor([each.std for each in law.parameters], dtype=torch.float64)
    covariance = torch.block_diag(torch.diag(stds.square()), law.covariance)
    return UncertainTerms(forcing.terms, forcing.coefficients.argmax(dim=0).tolist(), covariance)


def _record(drawn: EpisodeEnsemble, law: Law, members: int) -> ObservedRecord:
    fit, system = drawn.episode.split.fit, drawn.system
    values = fit.values.copy()
    faulty = {fault.sensor for fault in law.faults}
    values[:, [name in faulty for name in fit.names]] = math.nan
    march = March(system.with_fixed_steps() if np.isnan(system.dt) else system)
    states = drawn.ensemble.states
    radius = radius_for(system, len(fit.sensors), members)
    return ObservedRecord(
        march=march,
        states=lambda sample: march.off_grid(states[:, sample]),
        times=drawn.ensemble.times.numpy(),
        values=values,
        noise=drawn.episode.noise_of(fit.names).numpy(),
        operator=drawn.episode.operator(fit),
        tapers=sensor_tapers(system, fit.sensors, fit.sensors, radius),
    )
