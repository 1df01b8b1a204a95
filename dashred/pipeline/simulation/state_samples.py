"""Simulated states of all episodes, on which terms are compared."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import torch
from torch import Tensor

from dashred.physics.backends.input_signals import InputSignals
from dashred.physics.expressions.algebra import names
from dashred.physics.runs.initial_state_prior import StartPrior
from dashred.physics.system import System
from dashred.pipeline.problem import Problem
from dashred.pipeline.simulation.nominal_run import NominalRun
from dashred.pipeline.simulation.reading_range import distance_from_readings

# The samples of several episodes together are thinned to so many, but never below one episode's.
MOST_SAMPLES = 500
# A simulator that lacks what keeps it bounded drifts away. States whose readings are farther from
# the recorded ones than this many standard deviations say nothing about the size of a term, and
# those of a term of high order would be all that counts. So many samples have to remain.
FARTHEST, FEWEST = 5.0, 20
# Random changes of the start, which are added to the states.
CHANGES = 8


@dataclass(frozen=True)
class StateSamples:
    """States with their times.

    Attributes:
        system: the simulator; its inputs cover the times.
        states: ``(sample, field, *grid)``.
        times: ``(sample,)``.
        prior: of the start; None where there is none.
    """

    system: System
    states: Tensor
    times: Tensor
    prior: StartPrior | None = None

    @cached_property
    def moved(self) -> Tensor | None:
        """The same states, moved by random changes of the start; None without a prior."""
        return None if self.prior is None else moved_states(self.prior, self.states)


def state_samples(problem: Problem, nominal: NominalRun) -> StateSamples:
    """Return states of all fitted episodes, where they are within the range of the readings.

    What is constant in one episode, such as a direction of motion, may differ between episodes. If
    the system has inputs, their signals are laid end to end, on a clock that is shifted from
    episode to episode. A system that depends on the time itself is sampled in its longest episode.
    """
    episodes, paths = problem.episodes, nominal.references
    kept = [within_range(episode, path) for episode, path in zip(episodes, paths, strict=True)]
    if len(episodes) == 1 or _depends_on_time(problem):
        times = problem.times[kept[0]]
        return StateSamples(problem.system, paths[0][kept[0]], times, nominal.prior)
    stride = -(-sum(map(len, paths)) // max(MOST_SAMPLES, len(paths[0])))
    begin, clocks, signals = 0.0, [], []
    for episode, path, mine in zip(episodes, paths, kept, strict=True):
        own = episode.times[: len(path)]
        shift = begin - float(own[0])
        clocks.append(own[mine][::stride] + shift)
        signals.append((episode.system.input_signals, shift, own.numpy()))
        # Between two episodes lies as much time as a sample takes.
        begin += 2 * float(own[-1] - own[0]) / max(1, len(own) - 1) + float(own[-1] - own[0])
    states = torch.cat([path[mine][::stride] for path, mine in zip(paths, kept, strict=True)])
    system = problem.system
    if system.inputs:
        system = system.with_input_signals(_end_to_end(signals, list(system.inputs)))
    return StateSamples(system, states, torch.cat(clocks), nominal.prior)


def moved_states(prior: StartPrior, states: Tensor) -> Tensor:
    """Return states to which random changes of the start are added, a few in turn."""
    changes = prior.draw(CHANGES, np.random.default_rng(0)) - prior.centre
    return states + changes[torch.arange(len(states)) % CHANGES]


def within_range(episode: Problem, path: Tensor) -> Tensor:
    """Return whether each sample is within the range of the readings; all, if too few are."""
    near = distance_from_readings(episode, path) < FARTHEST
    return near if int(near.sum()) >= FEWEST else torch.ones_like(near)


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
