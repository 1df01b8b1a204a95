"""Time steps that resolve an ODE system over one segment of its recording."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import torch
from torch import Tensor

from dashred.data.sensors import Sensor
from dashred.inference.forward.candidates import Candidate
from dashred.inference.segments.segments import Array, cut
from dashred.inference.segments.state_sensors import StateSensors
from dashred.inference.segments.steps.segment_simulator import SegmentSimulator
from dashred.physics.runs.resolution import Resolution, minimum_scale
from dashred.pipeline.problem import Problem

# A numerical error below this share of the noise, over one segment, is negligible.
NOISE_SHARE = 0.02
# Share of the segments whose error decides: a badly guessed state may blow up.
QUANTILE = 0.9
# A simulator that lacks what holds it leaves the recording. So many std from its mean the errors of
# what follows tell nothing.
LEFT = 5.0


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
    was_chosen = problem.config.system.integrator.dt is None and system.program is not None
    if system.tableau is None or was_chosen:
        # An adaptive method chooses its steps. The calls of a program that found its step are not
        # made again.
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
    centre = traces.mean(axis=0)
    error = _typical_change(readings(1), fine, centre, scale)
    if error <= limit:
        return Resolution(error, limit, 1)
    next_error = _typical_change(fine, readings(4), centre, scale)
    return Resolution(error, limit, 2 if next_error <= limit else None)


def _typical_change(coarse: Array, fine: Array, centre: Array, scale: Array) -> float:
    """Return the largest rms change of a trace in nine of ten segments, in units of its scale.

    The other segments may be about to blow up: their states were badly guessed, or the simulator
    lacks what holds it there. A segment counts until it leaves the range of the recording. The
    change is infinite if most segments do so with the finer steps before their second sample.

    Args:
        coarse: readings with a time step, ``(segment, sample, sensor)``.
        fine: with half of it.
        centre: mean of each trace, ``(sensor,)``.
        scale: its size, ``(sensor,)``.
    """
    with np.errstate(invalid="ignore"):
        inside = (np.abs(fine - centre) <= LEFT * scale).all(axis=2)
    inside = np.logical_and.accumulate(inside, axis=1)
    bounded = inside[:, 1]
    if bounded.mean() <= 0.5:
        return np.inf
    change = np.where(inside[..., None], (fine - coarse) / scale, 0.0)[bounded]
    count = inside[bounded].sum(axis=1, keepdims=True)
    rms = np.sqrt(np.square(change).sum(axis=1) / count)
    typical = float(np.quantile(np.nan_to_num(rms, nan=np.inf), QUANTILE, axis=0).max())
    return typical if np.isfinite(typical) else np.inf
