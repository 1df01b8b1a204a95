"""Segments of the recording of an ODE system, and its simulator restarted along the readings."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from dashred.core.errors import InputError
from dashred.data.stated.saturation import at_stop
from dashred.inference.segments.first_nodes import first_nodes
from dashred.inference.segments.natural_scales import field_sizes
from dashred.inference.segments.segments import SAMPLES, Array, Segments, cut
from dashred.inference.segments.state_sensors import StateSensors
from dashred.inference.segments.steps.segment_simulator import SegmentSimulator
from dashred.physics.runs.initial_state_prior import StartPrior
from dashred.physics.tangents.ode_tangents import has_ode_tangents
from dashred.pipeline.problem import Problem
from dashred.pipeline.simulation.segment_resolution import resolve_steps

# A simulation has left the range of the recording if it is farther from its start than this many
# standard deviations of a field.
LOST = 50.0
# The range of a field that no sensor reads is unknown. It has grown without bounds if it is farther
# from its start than this many times its guessed standard deviation.
UNBOUNDED = 1e12
# A field stands still if it moves by less than this share of its standard deviation.
STILL = 1e-6
# Standard deviation of a field that no sensor reads, in spreads of its start.
SPREADS = 7.0


@dataclass(frozen=True)
class SegmentedRecord:
    """A recording and its simulator, cut into segments.

    Attributes:
        simulator: of all segments, with steps whose error is negligible against the noise.
        sensors: the fit sensors.
        noise_std: σ of each, ``(sensor,)``.
        start_mean: expected state at the first sample, ``(episode, field)``.
        start_std: its standard deviation, ``(field,)``.
        size: standard deviation of every field over the record, ``(field,)``.
        guesses: first guesses of the nodes, ``(segment, field)`` each.
    """

    simulator: SegmentSimulator
    sensors: StateSensors
    noise_std: Array
    start_mean: Array
    start_std: Array
    size: Array
    guesses: list[Array]

    def restarted(self) -> list[Tensor]:
        """Return the simulator's states, restarted at every node, ``(time, field)`` by episode.

        A segment that blows up stays at its node.

        Raises:
            InputError: the simulator is a program that fails at the states that were recorded.
        """
        nodes = self.guesses[-1]
        states = self.simulator.run(nodes, (), np.zeros(0))
        self._check_program(states)
        lost = ~np.isfinite(states).all(axis=(1, 2)) | (
            np.abs(states - nodes[:, None]) > 2 * SPREADS * self.size
        ).any(axis=(1, 2))
        states[lost] = nodes[lost, None]
        segments = self.simulator.segments
        return [
            torch.from_numpy(segments.join(states, episode))
            for episode in range(len(segments.begins))
        ]

    def _check_program(self, states: Array) -> None:
        system = self.simulator.systems[0]
        is_recorded = set(self.sensors.fields) == set(range(len(system.fields)))
        if system.program is None or system.program.failure is None or not is_recorded:
            return
        failed = np.flatnonzero(~np.isfinite(states).all(axis=(1, 2)))
        if failed.size:
            times = self.simulator.segments.times[failed]
            raise InputError(
                f"the simulator fails in {len(failed)} of {len(states)} parts of the recording, "
                f"the first from t = {times[0, 0]:g} to {times[0, -1]:g}",
                where=system.where("system.simulator"),
                hint=system.program.failure,
            )


def segment_record(
    problem: Problem,
    start: Tensor,
    prior: StartPrior | None,
    samples: int = SAMPLES,
    substeps: int = 1,
) -> SegmentedRecord:
    """Cut the fitted part of the recording, and guess the states.

    Args:
        problem: the recording of a system without axes.
        start: expected state at the first sample, ``(field,)``.
        prior: distribution of that state; None where only its mean is known.
        samples: from one node to the next.
        substeps: steps from sample to sample, at least.
    """
    episodes, mean = problem.episodes, start.numpy()
    segments, sensors = _cut(problem, samples), _state_sensors(problem)
    size = _sizes(segments, sensors, mean, prior)
    std = np.maximum(_spread(mean, prior), 1e-6 * size)
    noise = problem.fit_noise_std().numpy()
    simulator = SegmentSimulator([e.system for e in episodes], segments, substeps)
    means = np.repeat(mean[None], len(episodes), axis=0)
    nodes = first_nodes(simulator.of_step(problem.system.dt), sensors, means, size)
    fine = resolve_steps(simulator, sensors, noise, nodes[-1], (), np.zeros(0))
    return SegmentedRecord(fine, sensors, noise, means, std, size, nodes)


def _cut(problem: Problem, samples: int = SAMPLES) -> Segments:
    """Cut the fitted part of every episode."""
    fits = [(episode.times, episode.split.fit) for episode in problem.episodes]
    clocks = [times[: len(fit.times)].numpy() for times, fit in fits]
    relative = [episode.relative_noise(episode.split.fit) for episode in problem.episodes]
    stops = [at_stop(fit) for _, fit in fits]
    masks = [None if each is None else each.astype(float) for each in stops]
    return cut(clocks, [fit.values for _, fit in fits], samples, relative, masks)


def _state_sensors(problem: Problem) -> StateSensors:
    return StateSensors(problem.split.fit.sensors, problem.system)


def _sizes(
    segments: Segments, sensors: StateSensors, mean: Array, prior: StartPrior | None
) -> Array:
    """Return the standard deviation of every field over the record, ``(field,)``."""
    unread = np.maximum(SPREADS * _spread(mean, prior), 1e-6 + np.abs(mean))
    return field_sizes(segments, sensors, unread)


def _spread(mean: Array, prior: StartPrior | None) -> Array:
    """Return the standard deviation of every field of the start, ``(field,)``."""
    return np.abs(mean) if prior is None else start_std(prior)


def can_restart(problem: Problem) -> bool:
    """Return whether a simulator can be restarted along the readings: equations without axes."""
    system = problem.system
    return not system.axes and problem.snapshots is None and has_ode_tangents(system, ())


def restarted_where_lost(problem: Problem, start: Tensor, path: Tensor) -> tuple[Tensor, ...]:
    """Return the simulator restarted along the readings if its own run cannot represent them.

    It cannot if it leaves their range, or if a field stands still, as from a start at rest.

    Args:
        problem: the recording.
        start: nominal state at the first sample, ``(field,)``.
        path: simulation from there, ``(time, field)``.

    Returns:
        The states of each fitted episode at its times; empty if the simulation stays within range.
        Beyond the fitted part, whose readings alone are used, they are repeated.
    """
    segments, sensors = _cut(problem), _state_sensors(problem)
    scale = torch.from_numpy(_sizes(segments, sensors, start.numpy(), None))
    known = torch.tensor([j in sensors.fields for j in range(len(problem.system.fields))])
    away = (path - start).abs() / scale
    # NaN is not below the limit.
    inside = bool((away < torch.where(known, LOST, UNBOUNDED)).all())
    stands_still = bool((away[:, known].amax(dim=0) < STILL).any())
    if inside and not stands_still:
        return ()
    record = segment_record(problem, start, None)
    return tuple(
        states[torch.arange(len(episode.times)) % len(states)]
        for episode, states in zip(problem.episodes, record.restarted(), strict=True)
    )


def start_std(prior: StartPrior) -> Array:
    """Return the standard deviation of every field of a start, ``(field,)``."""
    centre = prior.start(torch.zeros((1, prior.size), dtype=torch.float64))
    moved = prior.start(torch.eye(prior.size, dtype=torch.float64)) - centre
    found: Array = moved.square().sum(dim=0).sqrt().numpy()
    return found
