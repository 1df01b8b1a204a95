"""Simulated states of all episodes, on which terms are compared."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from dashred.physics.backends.input_signals import InputSignals
from dashred.physics.expressions.algebra import names
from dashred.physics.system import System
from dashred.pipeline.problem import Problem
from dashred.pipeline.simulation.nominal_run import NominalRun

# The samples of several episodes together are thinned to so many, but never below one episode's.
MOST_SAMPLES = 500


@dataclass(frozen=True)
class StateSamples:
    """States with their times.

    Attributes:
        system: the simulator; its inputs cover the times.
        states: ``(sample, field, *grid)``.
        times: ``(sample,)``.
    """

    system: System
    states: Tensor
    times: Tensor


def state_samples(problem: Problem, nominal: NominalRun) -> StateSamples:
    """Return states of all fitted episodes.

    What is constant in one episode, such as a direction of motion, may differ between episodes. If
    the system has inputs, their signals are laid end to end, on a clock that is shifted from
    episode to episode. A system that depends on the time itself is sampled in its longest episode.
    """
    episodes, paths = problem.episodes, nominal.references
    if len(episodes) == 1 or _depends_on_time(problem):
        return StateSamples(problem.system, paths[0], problem.times)
    stride = -(-sum(map(len, paths)) // max(MOST_SAMPLES, len(paths[0])))
    begin, clocks, signals = 0.0, [], []
    for episode, path in zip(episodes, paths, strict=True):
        own = episode.times[: len(path)]
        shift = begin - float(own[0])
        clocks.append(own[::stride] + shift)
        signals.append((episode.system.input_signals, shift, own.numpy()))
        # Between two episodes lies as much time as a sample takes.
        begin += 2 * float(own[-1] - own[0]) / max(1, len(own) - 1) + float(own[-1] - own[0])
    states = torch.cat([path[::stride] for path in paths])
    system = problem.system
    if system.inputs:
        system = System(system.config, system.where, _end_to_end(signals, list(system.inputs)))
    return StateSamples(system, states, torch.cat(clocks))


def _end_to_end(
    signals: list[tuple[InputSignals, float, np.ndarray]], inputs: list[str]
) -> InputSignals:
    """Return the values of the inputs at the samples of each episode, on the shifted clock."""
    times = np.concatenate([own + shift for _, shift, own in signals])
    sampled = [signal.at(own) for signal, _, own in signals]
    return InputSignals(times, {n: np.concatenate([each[n] for each in sampled]) for n in inputs})


def _depends_on_time(problem: Problem) -> bool:
    system = problem.system
    terms = [system.resolve(term.expression, "library") for term in problem.library]
    return any("t" in names(expr) for expr in (*system.resolved.values(), *terms))
