"""Choose the time step of a simulator that states none.

The step divides the sampling interval by a power of two. It is the largest one for which half of it
changes the readings over one segment, a few samples, by less than a twentieth of the noise. Over
the whole record a chaotic trajectory turns any change into another trajectory. An instability of
the method hides from a few samples (:mod:`dashred.physics.runs.step_stability`).
"""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np
import torch
from torch import Tensor

from dashred.core.budget import Budget, Deadline, OutOfTimeError
from dashred.core.errors import InputError
from dashred.data.observation_operator import ObservationOperator
from dashred.data.recording import Recording
from dashred.inference.segments.segments import SAMPLES
from dashred.physics.expressions.algebra import Name
from dashred.physics.external.failure import hint_of_failure
from dashred.physics.runs.initial_state_prior import nominal_start
from dashred.physics.runs.step_stability import Along, is_stable
from dashred.physics.runs.tendency_size import tendency_size
from dashred.physics.solvers.simulate import simulate
from dashred.physics.system import System, Term
from dashred.pipeline.time_shares import ENDS, takes_too_long

# Allowed change of a reading in units of σ, and the least σ as a share of a trace's std.
NOISE_SHARE, LEAST_NOISE = 1 / 20, 0.01
# Size of the terms that probe the error of splitting, as a share of the tendency; and the factor by
# which this error may be larger, because it is a share of the law.
PROBE, SPLITTING = 0.2, 4.0
# The step is at least the sampling interval divided by 2 to this power.
MAX_HALVINGS = 12
# Number of segments over the record.
SEGMENTS = 8
# Number of states from which perturbations grow.
STATES = 3
# Allowed change of a trace that is constant.
SMALLEST = 1e-12


def states_time_step(system: System) -> bool:
    """Return whether the configuration gives a time step, or needs none.

    An adaptive method has no step. The analysis has fixed steps in its place.
    """
    is_fixed = system.with_fixed_steps() is system
    return (is_fixed and not math.isnan(system.dt)) or system.config.snapshots is not None


@torch.no_grad()
def with_time_step(
    system: System, recording: Recording, noise: np.ndarray, limit: float, budget: Budget
) -> tuple[System, str]:
    """Return a system with a time step, and one clause on how it was chosen.

    For an expensive program it is that of the samples: to choose it would take most of the budget.
    The error of splitting is measured with the law.

    If the budget gives no time to choose, it is the last step that was tried.

    Fixed steps of ``rk4`` take the place of an adaptive method. They have exact derivatives, and
    they are compiled: an adaptive method takes many times as long.

    Args:
        system: the simulator, driven by the inputs of the recording.
        recording: the fitted part of the recording.
        noise: σ of its sensors, ``(sensor,)``.
        limit: largest change of a trace over the record at doubled resolution, in its std.
        budget: of the run.

    Raises:
        InputError: no step is short enough.
    """
    times = torch.from_numpy(recording.times)
    interval = float((times[1:] - times[:-1]).median())
    splits = system.program is not None
    allowed = _allowed_change(recording, noise, limit, bool(system.axes), splits)
    fixed = system.with_fixed_steps()
    of = "" if fixed is system else f" of {fixed.method} in place of {system.method}"
    longest = fixed.with_step(interval)
    if splits and _takes_too_long(longest, times, budget):
        return longest, f"time step: {interval:.6g}, that of the samples, because a call takes long"
    deadline = budget.deadline(ENDS["simulate"])
    steps = [interval / 2**halvings for halvings in range(MAX_HALVINGS + 1)]
    tried = steps[0]
    probed = _with_probe(longest, times) if splits else fixed
    try:
        for coarse, fine in pairwise(map(probed.with_step, steps)):
            tried = coarse.dt
            change, along = _change(coarse, fine, recording, allowed, deadline)
            if change <= 1 and is_stable(coarse, along, deadline.check):
                why = (
                    f"time step: {tried:.6g}{of}, whose error without a law is far below the noise"
                )
                return fixed.with_step(tried), why
    except OutOfTimeError:
        # The check of the resolution tells whether it suffices.
        why = f"time step: {tried:.6g}{of}, the last one tried: the budget gives no more time"
        return fixed.with_step(tried), why
    hint = "give system.integrator.dt, or look at the signs of the equations"
    raise InputError(
        f"a time step of {tried:.3g} is still too long for the noise of the recording",
        where=system.where("system.integrator"),
        hint=hint_of_failure(system.program, hint),
    )


def _takes_too_long(system: System, times: Tensor, budget: Budget) -> bool:
    """Return whether a program is expensive, after its first call."""
    simulate(system, nominal_start(system), times[:2])
    return takes_too_long(system, times, budget)


def _with_probe(system: System, times: Tensor) -> System:
    """Return a program with a small damping of every field, to measure the error of splitting.

    Without a law beside it a program has no such error, whatever the step.
    """
    path = simulate(system, nominal_start(system), times)[0]
    bounded = torch.isfinite(path).reshape(len(path), -1).all(dim=1)
    path, clock = path[bounded], times[bounded]
    size = path.transpose(0, 1).flatten(1).square().mean(dim=1).sqrt()
    probe = PROBE * tendency_size(system, path, clock) / size.clamp(min=SMALLEST)
    damped = zip(system.fields, (-probe).tolist(), strict=True)
    return system.with_terms([(Term(name, Name(name)), value) for name, value in damped])


def _allowed_change(
    recording: Recording, noise: np.ndarray, limit: float, has_axes: bool, splits: bool
) -> Tensor:
    """Return the allowed change of each sensor over one segment, ``(sensor,)``.

    The changes of all segments add up over the record. An ODE system whose phase is off by as much
    as the noise would be given a term that turns it back.
    """
    std = recording.trace_std()
    count = max(1.0, len(recording.times) / SAMPLES)
    by_noise = NOISE_SHARE * np.maximum(noise, LEAST_NOISE * std)
    if splits or not has_axes:
        by_noise = by_noise / count
    if splits:
        by_noise = by_noise * SPLITTING
    return torch.from_numpy(np.minimum(by_noise, limit * std / count)).clamp(min=SMALLEST)


def _change(
    coarse: System, fine: System, recording: Recording, allowed: Tensor, deadline: Deadline
) -> tuple[float, Along]:
    """Return the largest change of a reading over a segment, in units of the allowed change.

    The second value has states along the simulation.
    """
    times, operator = (
        torch.from_numpy(recording.times),
        ObservationOperator(recording.sensors, fine),
    )

    def timed(done: float) -> None:
        deadline.check()

    end, duration = float(times[-1]), float(times[-1] - times[0])
    nowhere = Along(torch.empty(0), times[:0], end, duration)
    try:
        start = nominal_start(fine, timed)
    except InputError:
        return math.inf, nowhere
    rough = simulate(coarse, start, times, progress=timed)[0]
    # The states of a program differ little, and a run of it may take long.
    path = rough if coarse.program else simulate(fine, start, times, progress=timed)[0]
    if torch.isfinite(path).all() and not torch.isfinite(rough).all():
        return math.inf, nowhere
    known = _within_range(operator(path[None])[0], recording)
    largest = 0.0
    for first in known[:: max(1, len(known) // SEGMENTS)]:
        clock, state = times[first : first + SAMPLES + 1], path[first : first + 1]
        pair = [operator(simulate(system, state, clock))[0] for system in (coarse, fine)]
        # A program that cannot step a state cannot do so with any step.
        if coarse.program and not any(readings.isfinite().all() for readings in pair):
            continue
        change = (pair[0] - pair[1]).square().mean(dim=0).sqrt() / allowed
        largest = max(largest, float(change.max().nan_to_num(nan=math.inf)))
    # A call of a program may take long, and most programs choose their own stable steps.
    probed = known[:1] if coarse.program else known[:: max(1, len(known) // STATES)]
    return largest, Along(path[probed], times[probed], end, duration)


def _within_range(readings: Tensor, recording: Recording) -> list[int]:
    """Return the samples at which a segment can begin: the simulation is like the recording.

    A simulator that lacks what bounds it leaves the range of the recording; the start is kept.
    """
    is_read = recording.is_read()
    values, readings = recording.values[:, is_read], readings[:, torch.from_numpy(is_read)]
    low, high = np.nanmin(values, axis=0), np.nanmax(values, axis=0)
    width = np.maximum(high - low, 1e-12)
    read = readings.numpy()[: len(values) - SAMPLES]
    with np.errstate(invalid="ignore"):
        inside = ((read > low - width) & (read < high + width)).all(axis=1)
    return [0, *np.flatnonzero(np.logical_and.accumulate(inside)[1:]) + 1]
