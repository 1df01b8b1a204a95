"""The recording of an ODE system in segments: its simulator restarted along the readings."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from dashred.inference.segments.first_nodes import first_nodes
from dashred.inference.segments.natural_scales import field_sizes
from dashred.inference.segments.segment_simulator import SegmentSimulator
from dashred.inference.segments.segments import Array, cut
from dashred.inference.segments.state_sensors import StateSensors
from dashred.physics.runs.initial_state_prior import StartPrior
from dashred.pipeline.problem import Problem

# A numerical error of this share of the noise, over one segment, changes nothing.
NOISE_SHARE = 0.05
MOST_SUBSTEPS = 64
# How far a field that no sensor reads may go, in spreads of its start.
SPREADS = 7.0


@dataclass(frozen=True)
class SegmentedRecord:
    """A recording and its simulator, cut into segments.

    Attributes:
        simulator: of all segments, with steps that are as fine as the noise asks for.
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


def segment_record(problem: Problem, start: Tensor, prior: StartPrior | None) -> SegmentedRecord:
    """Cut the fitted part of the recording, and guess the states.

    Args:
        problem: the recording of a system without axes.
        start: expected state at the first sample, ``(field,)``.
        prior: distribution of that state; None where only its mean is known.
    """
    episodes = problem.episodes
    fits = [episode.split.fit for episode in episodes]
    segments = cut(
        [e.times[: len(fit.times)].numpy() for e, fit in zip(episodes, fits, strict=True)],
        [fit.values for fit in fits],
    )
    sensors = StateSensors(problem.split.fit.sensors, problem.system)
    mean = start.numpy()
    spread = np.abs(mean) if prior is None else start_std(prior)
    size = field_sizes(segments, sensors, np.maximum(SPREADS * spread, 1e-6 + np.abs(mean)))
    std = np.maximum(spread, 1e-6 * size)
    noise = problem.noise_of(problem.split.fit.names).numpy()
    simulator = SegmentSimulator([e.system for e in episodes], segments, 1)
    means = np.repeat(mean[None], len(episodes), axis=0)
    nodes = first_nodes(simulator.of_step(problem.system.dt), sensors, means, size)
    fine = _fine_enough(simulator, sensors, nodes[-1], noise)
    return SegmentedRecord(fine, sensors, noise, means, std, size, nodes)


def start_std(prior: StartPrior) -> Array:
    """Return the standard deviation of every field of a start, ``(field,)``."""
    centre = prior.start(torch.zeros((1, prior.size), dtype=torch.float64))
    moved = prior.start(torch.eye(prior.size, dtype=torch.float64)) - centre
    found: Array = moved.square().sum(dim=0).sqrt().numpy()
    return found


def _fine_enough(
    simulator: SegmentSimulator, sensors: StateSensors, nodes: Array, noise: Array
) -> SegmentSimulator:
    """Return the simulator with so many steps that twice as many change no reading."""
    coarse = sensors.read(simulator.run(nodes, (), np.zeros(0)))
    while simulator.substeps < MOST_SUBSTEPS:
        finer = simulator.with_substeps(2 * simulator.substeps)
        fine = sensors.read(finer.run(nodes, (), np.zeros(0)))
        change = np.abs(fine - coarse).max(axis=1) / noise
        known = np.isfinite(change).all(axis=1)
        # A state that was guessed badly may blow up; nine of ten decide.
        if known.mean() > 0.5 and np.quantile(change[known], 0.9) < NOISE_SHARE:
            return simulator
        simulator, coarse = finer, fine
    return simulator
