"""Segments of the recording of an ODE system, and its simulator restarted along the readings."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from dashred.data.sensors import Sensor
from dashred.inference.forward.candidates import Candidate
from dashred.inference.segments.first_nodes import first_nodes
from dashred.inference.segments.natural_scales import field_sizes
from dashred.inference.segments.segment_simulator import SegmentSimulator
from dashred.inference.segments.segments import SAMPLES, Array, Segments, cut
from dashred.inference.segments.state_sensors import StateSensors
from dashred.physics.runs.initial_state_prior import StartPrior
from dashred.physics.runs.resolution import Resolution, minimum_scale
from dashred.physics.tangents.ode_tangents import has_ode_tangents
from dashred.pipeline.problem import Problem

# A numerical error below this share of the noise, over one segment, is negligible.
NOISE_SHARE = 0.02
# Share of the segments whose error decides: a badly guessed state may blow up.
QUANTILE = 0.9
# A simulation has left the range of the recording if it is farther from its start than this many
# standard deviations of a field.
LOST = 50.0
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
        """
        nodes = self.guesses[-1]
        states = self.simulator.run(nodes, (), np.zeros(0))
        lost = ~np.isfinite(states).all(axis=(1, 2)) | (
            np.abs(states - nodes[:, None]) > 2 * SPREADS * self.size
        ).any(axis=(1, 2))
        states[lost] = nodes[lost, None]
        segments = self.simulator.segments
        return [
            torch.from_numpy(segments.join(states, episode))
            for episode in range(len(segments.begins))
        ]


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
    return cut(clocks, [fit.values for _, fit in fits], samples)


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
    # The range of a field that no sensor reads is unknown.
    reads = {sensor.reads for sensor in problem.split.fit.sensors}
    known = torch.tensor([field in reads for field in problem.system.fields])
    away = ((path - start).abs() / scale)[:, known]
    stands_still = bool((away.amax(dim=0) < STILL).any())
    if bool((away < LOST).all()) and bool(torch.isfinite(path).all()) and not stands_still:
        return ()
    record = segment_record(problem, start, None)
    return tuple(
        states[torch.arange(len(episode.times)) % len(states)]
        for episode, states in zip(problem.episodes, record.restarted(), strict=True)
    )


def local_resolution(
    problem: Problem,
    sensors: Sequence[Sensor],
    references: Sequence[Tensor],
    noise: Tensor,
    limit: float,
) -> Resolution:
    """Return the change of the readings at half the time step, over one segment.

    Over the whole record a chaotic trajectory would turn any change into another trajectory.

    Args:
        problem: the recording.
        sensors: whose readings are compared.
        references: states of each episode, from which the segments start.
        noise: σ of the sensors, ``(sensor,)``.
        limit: allowed change, as a share of a trace's std.
    """
    system, episodes = problem.system, problem.episodes
    if system.tableau is None:
        return Resolution(0.0, limit, 1)
    clocks = [episode.times.numpy() for episode in episodes]
    segments = cut(clocks, [states.numpy() for states in references])
    simulator = SegmentSimulator([e.system for e in episodes], segments, 1).of_step(system.dt)
    read = StateSensors(sensors, system)
    traces = read.read(np.concatenate([states.numpy() for states in references]))
    reads = [sensor.reads for sensor in sensors]
    least = minimum_scale(torch.from_numpy(traces), noise, reads, limit).numpy()
    scale = np.maximum(np.maximum(traces.std(axis=0), least), 1e-12)
    nodes = segments.readings[:, 0]

    def readings(factor: int) -> Array:
        finer = simulator.with_substeps(factor * simulator.substeps)
        return read.read(finer.run(nodes, (), np.zeros(0)))

    fine = readings(2)
    error = _typical_change(readings(1), fine, scale)
    if error <= limit:
        return Resolution(error, limit, 1)
    next_error = _typical_change(fine, readings(4), scale)
    return Resolution(error, limit, 2 if next_error <= limit else None)


def _typical_change(coarse: Array, fine: Array, scale: Array) -> float:
    """Return the largest rms change of a trace in nine of ten segments, in units of its scale.

    The other segments may be about to blow up: their states were badly guessed, or the simulator
    lacks what holds it there. It is infinite if most segments blow up with the finer steps too.
    """
    bounded = np.isfinite(fine).all(axis=(1, 2))
    if bounded.mean() <= 0.5:
        return np.inf
    change = (fine[bounded] - coarse[bounded]) / scale
    rms = np.sqrt(np.square(change).mean(axis=1))
    typical = float(np.quantile(np.nan_to_num(rms, nan=np.inf), QUANTILE, axis=0).max())
    return typical if np.isfinite(typical) else np.inf


def start_std(prior: StartPrior) -> Array:
    """Return the standard deviation of every field of a start, ``(field,)``."""
    centre = prior.start(torch.zeros((1, prior.size), dtype=torch.float64))
    moved = prior.start(torch.eye(prior.size, dtype=torch.float64)) - centre
    found: Array = moved.square().sum(dim=0).sqrt().numpy()
    return found


def resolve_steps(
    simulator: SegmentSimulator,
    sensors: StateSensors,
    noise: Array,
    nodes: Array,
    candidates: Sequence[Candidate],
    xi: Array,
) -> SegmentSimulator:
    """Return the simulator with the fewest steps whose numerical error is negligible.

    Args:
        simulator: of the segments.
        sensors: what they read.
        noise: σ of each, ``(sensor,)``.
        nodes: states, ``(segment, field)``.
        candidates: terms that are added.
        xi: their coefficients.
    """
    coarse = sensors.read(simulator.run(nodes, candidates, xi))
    # The system's own step is fine enough, as its resolution was checked.
    most = simulator.of_step(simulator.systems[0].dt).substeps
    while simulator.substeps < most:
        finer = simulator.with_substeps(min(most, 2 * simulator.substeps))
        fine = sensors.read(finer.run(nodes, candidates, xi))
        change = np.abs(fine - coarse).max(axis=1) / noise
        known = np.isfinite(change).all(axis=1)
        if known.mean() > 0.5 and np.quantile(change[known], QUANTILE) < NOISE_SHARE:
            return simulator
        simulator, coarse = finer, fine
    return simulator
