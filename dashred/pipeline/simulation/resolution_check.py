"""Check of the numerical resolution of the simulation, and of the corrected one."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import torch
from torch import Tensor

from dashred.core.progress import stage
from dashred.data.observation_operator import ObservationOperator
from dashred.data.sensors import Sensor
from dashred.inference.fit.law import Law
from dashred.inference.results.corrected_system import build_corrected_system
from dashred.physics.runs.resolution import (
    SEGMENT,
    Resolution,
    accumulated_error,
    check_resolution,
    minimum_scale,
)
from dashred.physics.solvers.simulate import Progress
from dashred.physics.system import System
from dashred.pipeline.problem import Problem
from dashred.pipeline.simulation.nominal_run import NominalRun
from dashred.pipeline.simulation.segment_resolution import local_resolution
from dashred.pipeline.simulation.segmented_record import can_restart
from dashred.pipeline.simulation.time_limit import within

# First part of a record in which a simulation without its dissipation may still be resolved.
EARLY_SHARE = 0.25


@dataclass(frozen=True)
class SensorTraces:
    """The traces whose change at doubled resolution is measured.

    Attributes:
        sensors: whose readings are compared.
        noise: σ of each, ``(sensor,)``.
        limit: allowed change, as a share of a trace's std.
    """

    sensors: Sequence[Sensor]
    noise: Tensor
    limit: float

    def read(self, system: System, states: Tensor) -> Tensor:
        """Return readings ``(batch, time, sensor)`` of states on a system's grid."""
        return ObservationOperator(self.sensors, system)(states)

    def least(self, traces: Tensor) -> Tensor:
        """Return the smallest scale for the change of each of some traces, ``(sensor,)``."""
        reads = [sensor.reads for sensor in self.sensors]
        return minimum_scale(traces, self.noise, reads, self.limit)

    def over_record(
        self, system: System, path: Tensor, times: Tensor, progress: Progress
    ) -> Resolution:
        """Return the change over the whole record, and the resolution that suffices."""
        coarse = self.read(system, path[None])
        least = self.least(coarse[0])
        return check_resolution(
            system, path[:1], times, coarse, self.read, least, self.limit, progress
        )

    def over_segments(
        self,
        system: System,
        path: Tensor,
        times: Tensor,
        share: float = 1.0,
        samples: int = SEGMENT,
    ) -> Resolution:
        """Return the changes of short segments, added up over the record.

        Args:
            system: the simulator.
            path: states from which the segments start, ``(time, field, *grid)``.
            times: ``(time,)``.
            share: first part of the record whose segments are simulated.
            samples: of a segment.
        """
        least = self.least(self.read(system, path[None])[0])
        summed = accumulated_error(system, path, times, self.read, least, share, samples)
        enough = 1 if summed <= self.limit else None
        return Resolution(summed, self.limit, enough, is_early=share < 1)


@torch.no_grad()
def check_discretisation(
    problem: Problem, nominal: NominalRun, seconds: dict[str, float]
) -> Resolution:
    """Double the resolution and return the largest change of the sensor readings.

    If the record is chaotic, the errors of short segments are added up instead
    (:func:`.resolution.accumulated_error`). If only those of the first part are small, and no finer
    grid is sufficient, the search may find the dissipation that the simulation lacks. The
    resolution of the corrected simulation is checked then (:func:`check_corrected`). The same holds
    for a run that is corrected towards the readings, of which the error from one sample to the next
    is measured.

    If the system has inputs, every episode is checked and the worst result is returned. Without
    inputs all episodes have the same simulation, so one is checked.
    """
    every = (*problem.split.fit.sensors, *problem.split.validation.sensors)
    sensors = tuple({sensor.name: sensor for sensor in every}.values())
    noise, limit = problem.noise_of(tuple(s.name for s in sensors)), problem.config.resolution_limit
    if can_restart(problem):
        with stage("check the resolution", seconds) as report:
            local = local_resolution(problem, sensors, nominal.references, noise, limit)
            report(1.0, f"doubling changes a trace by {local.error:.2%} of its std in a segment")
        return local
    traces = SensorTraces(sensors, noise, limit)

    def checked(episode: Problem, path: Tensor) -> Resolution:
        system, times = episode.system, episode.times
        if nominal.restarted:
            # It is corrected at every sample: its errors do not add up.
            count = len(episode.split.fit.times)
            found = traces.over_segments(system, path[:count], times[:count], samples=1)
            each = found.error / (count - 1)
            return Resolution(each, limit, 1 if each <= limit else None, is_early=True)
        progress = within(problem.deadline("simulate"), report)
        found = traces.over_record(system, path, times, progress)
        # If a finer grid is sufficient, it is better to use it.
        shares = () if found.resolved else (1.0,) if found.enough else (1.0, EARLY_SHARE)
        for share in shares:
            summed = traces.over_segments(system, path, times, share)
            if summed.resolved:
                return summed
        return found

    episodes = problem.episodes if problem.system.inputs else (problem,)
    with stage("check the resolution", seconds) as report:
        resolutions = [checked(*pair) for pair in zip(episodes, nominal.references, strict=False)]
        worst = max(resolutions, key=lambda resolution: resolution.error)
        report(1.0, f"doubling changes a trace by {worst.error:.2%} of its std")
    return worst


@torch.no_grad()
def check_corrected(problem: Problem, law: Law, states: Tensor) -> Resolution:
    """Return the resolution of the corrected simulation of the longest episode.

    Args:
        problem: the recording.
        law: the law.
        states: the corrected simulation in the fit window, ``(time, field, *grid)``.
    """
    fit, limit = problem.split.fit, problem.config.resolution_limit
    traces = SensorTraces(fit.sensors, problem.noise_of(fit.names), limit)
    system = build_corrected_system(problem.system, law)
    return traces.over_segments(system, states, problem.times[: len(states)])
