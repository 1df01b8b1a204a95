"""What the ensemble methods share: members with coefficients, their runs, and their law."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import pairwise
from statistics import NormalDist
from typing import NamedTuple

import numpy as np

from dashred.evaluation.baselines.estimate import TermEntry
from dashred.evaluation.foreign.cases.case import Array
from dashred.evaluation.foreign.peers.measured import (
    Measured,
    NoAnswerError,
    check_fit,
    entries_of,
)
from dashred.evaluation.foreign.peers.shooting.flow import Flow
from dashred.physics.system import Term

STEPS_PER_SAMPLE = 3
# Prior std of a coefficient, relative to the tendency of its equation. With a wider prior most
# members blow up.
WIDTH = 0.2
# Probability that any term of the law is spurious.
SIGNIFICANCE = 0.05


class Ensemble:
    """Members of start and coefficients ``(member, field + term)``, and their runs.

    Args:
        given: readings and simulator.
        library: the terms.

    Attributes:
        mean: of the prior, ``(field + term,)``.
        std: of the prior, ``(field + term,)``.
    """

    def __init__(self, given: Measured, library: Sequence[Term]) -> None:
        self.flow = Flow(given.system, library, given.scale, STEPS_PER_SAMPLE)
        scale = self.flow.coefficient_scale(given.first_states, given.times)
        self.mean = np.concatenate([given.start, np.zeros(len(scale))])
        self.std = np.concatenate([given.spread, WIDTH * scale])
        self.fields = len(given.start)

    def draw(self, count: int, rng: np.random.Generator) -> Array:
        """Return members of the prior."""
        return self.mean + self.std * rng.standard_normal((count, len(self.mean)))

    def advance(self, members: Array, time: float, span: float) -> Array:
        """Return members with their states a time ``span`` later; not finite after a blow-up."""
        states, coefficients = members[:, : self.fields], members[:, self.fields :]
        times = np.full(len(members), time)
        with np.errstate(all="ignore"):
            after = self.flow.advance(states, times, coefficients, span)
        return np.concatenate([after, coefficients], axis=1)

    def run(self, members: Array, times: Array) -> Array:
        """Return the trajectories of members, ``(member, time, field)``."""
        path = [members]
        for now, then in pairwise(times.tolist()):
            path.append(self.advance(path[-1], now, then - now))
        return np.stack(path, axis=1)[:, :, : self.fields]


class Estimate(NamedTuple):
    """What a method returns.

    Attributes:
        mean: of the coefficients, ``(term,)``.
        std: of the coefficients, ``(term,)``.
        misfit: mean square of the misfits to the readings, in units of the noise.
    """

    mean: Array
    std: Array
    misfit: float


def law_of(given: Measured, estimate: Callable[[Measured, Ensemble], Estimate]) -> list[TermEntry]:
    """Return the law of a method: the terms that differ from zero, estimated again alone.

    The narrow prior makes the coefficients of terms that resemble each other too small. Those of
    the few terms are estimated without the others.

    Raises:
        NoAnswerError: the last estimate does not fit, or a coefficient is not finite.
    """
    few = given.library
    found = estimate(given, Ensemble(given, few))
    chosen = _significant(found)
    if chosen:
        few = [few[j] for j in chosen]
        found = estimate(given, Ensemble(given, few))
        chosen = _significant(found)
    check_fit(found.misfit)
    return entries_of([few[j] for j in chosen], found.mean[chosen])


def _significant(found: Estimate) -> list[int]:
    """Return the coefficients that differ from zero, with a joint confidence of 95 %."""
    mean, std, _ = found
    if not (np.isfinite(mean).all() and np.isfinite(std).all()):
        raise NoAnswerError("the ensemble has diverged")
    least = NormalDist().inv_cdf(1 - SIGNIFICANCE / (2 * len(mean)))
    return np.flatnonzero(np.abs(mean) > least * std).tolist()
