"""Ensembles of simulations with random initial states and random discrepancies."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np
import torch
from torch import Tensor

from dashred.physics.runs.members import simulate_members
from dashred.physics.runs.rounds import draw_until_enough
from dashred.physics.runs.stored_states import States
from dashred.physics.runs.tendency_size import tendency_size
from dashred.physics.solvers.forcing import Forcing
from dashred.physics.solvers.simulate import Progress
from dashred.physics.system import System, Term
from dashred.physics.terms.column_blocks import rms_of_columns
from dashred.physics.terms.library import resolve


class StartDistribution(Protocol):
    """Distribution of the members' initial states, such as ``StartPrior``."""

    @property
    def size(self) -> int:
        """Number of independent standard normals z of a state."""

    def start(self, z: Tensor) -> Tensor:
        """Return the initial states of z, ``(count, size)``."""

    def draw(self, count: int, rng: np.random.Generator) -> Tensor:
        """Return ``count`` random initial states, ``(count, field, *grid)``."""


@dataclass(frozen=True)
class Ensemble:
    """Simulated trajectories with the coefficients of each member's random terms.

    Attributes:
        times: ``(time,)``, on the recording's clock.
        states: ``(member, time, field, *grid)``, float64; in memory or on disk.
        coefficients: ``(member, term)``; all zero for a plain ensemble.
    """

    times: Tensor
    states: States
    coefficients: Tensor


class ModelErrors(Protocol):
    """Distribution of terms that are added to the simulator of each member."""

    @property
    def identity(self) -> list[object]:
        """What determines the distribution, as plain values."""

    def draw(
        self,
        system: System,
        nominal: Tensor,
        times: Tensor,
        members: int,
        rng: np.random.Generator,
    ) -> Forcing:
        """Return the terms of members, each with its own coefficients.

        Args:
            system: the simulator.
            nominal: a simulation, ``(time, field, *grid)``, for scales.
            times: its times, at least.
            members: number of members.
            rng: random number generator.
        """


@dataclass(frozen=True)
class Discrepancies:
    """Distribution of random model errors: a number of library terms for each member.

    Coefficients are ``ξ_j ~ N(0, amplitude² s_j²)`` with ``s_j = rms(∂u/∂t)/rms(θ_j)`` over the
    nominal simulation, so that the tendency of a term is about ``amplitude`` of the equation's.

    A decoder trained on the nominal simulator cannot represent the real field, but a decoder
    trained on perturbed simulators can. The errors depend on the library only, not on the
    recording.

    Attributes:
        library: terms to draw from.
        terms: number of terms for each member; all of a smaller library.
        amplitude: relative size of their tendencies.
    """

    library: Sequence[Term]
    terms: int
    amplitude: float

    @property
    def identity(self) -> list[object]:
        """See :class:`ModelErrors`."""
        return [*map(str, self.library), self.terms, self.amplitude]

    def draw(
        self,
        system: System,
        nominal: Tensor,
        times: Tensor,
        members: int,
        rng: np.random.Generator,
    ) -> Forcing:
        """See :class:`ModelErrors`."""
        size = min(self.terms, len(self.library))
        known = min(len(nominal), len(times))
        scales = term_scales(system, self.library, nominal[:known], times[:known])
        coefficients = np.zeros((members, len(self.library)))
        for row in coefficients:
            chosen = rng.choice(len(self.library), size=size, replace=False)
            row[chosen] = self.amplitude * rng.standard_normal(len(chosen))
        return Forcing(resolve(system, self.library), torch.from_numpy(coefficients) * scales)


def term_scales(
    system: System, library: Sequence[Term], nominal: Tensor, t: float | Tensor
) -> Tensor:
    """Return ``s_j = rms(tendency)/rms(θ_j)``, ``(term,)``.

    Args:
        system: the simulator.
        library: the terms θ_j.
        nominal: its states, ``(time, field, *grid)``.
        t: one time for all states, or the time of each, ``(time,)``.
    """
    rms = tendency_size(system, nominal, t)
    columns = rms_of_columns(system, library, nominal, t)
    of_equation = [system.fields.index(term.equation) for term in library]
    return rms[of_equation] / columns.clamp(min=1e-12)


@dataclass(frozen=True)
class MemberSource:
    """What the random members of an ensemble are drawn from.

    Attributes:
        system: the simulator.
        times: output times, on the recording's clock.
        prior: distribution of the initial states.
        nominal: the nominal simulation, ``(time, field, *grid)``, for scales and ranges.
        errors: random model errors; None for a plain ensemble.
        rng: random number generator.
        progress: called with the fraction done of each round of simulations.
    """

    system: System
    times: Tensor
    prior: StartDistribution
    nominal: Tensor
    errors: ModelErrors | None
    rng: np.random.Generator
    progress: Progress | None = None

    def forcing(self, members: int) -> Forcing:
        """Return random model errors of members; none for a plain ensemble."""
        if self.errors is None:
            return Forcing((), torch.zeros((members, 0), dtype=torch.float64))
        return self.errors.draw(self.system, self.nominal, self.times, members, self.rng)


def draw_ensemble(source: MemberSource, members: int) -> Ensemble:
    """Simulate random members that stay bounded.

    A member that blows up, or leaves the range of the nominal simulation and of its own start by
    more than the width of this range, is drawn again: a single diverging member would dominate
    every scale. If members are still missing after the last round, or when the time is up, half of
    them are enough.

    Args:
        source: what members are drawn from.
        members: number of trajectories.

    Raises:
        InputError: too few members stay bounded.
        OutOfTimeError: raised by ``source.progress`` before there were enough members.
    """
    found = MembersInMemory(source)
    draw_until_enough(found, members, source.system)
    return Ensemble(source.times, torch.cat(found.states), torch.cat(found.coefficients))


@dataclass
class MembersInMemory:
    """Members (:class:`.rounds.Members`) in memory.

    Attributes:
        source: what members are drawn from.
        states: of the members of each round, ``(member, time, field, *grid)``.
        coefficients: of the members of each round, ``(member, term)``.
    """

    source: MemberSource
    states: list[Tensor] = field(default_factory=list)
    coefficients: list[Tensor] = field(default_factory=list)

    @property
    def count(self) -> int:
        """Number of members."""
        return sum(map(len, self.states))

    def draw(self, missing: int, rounds_left: float) -> None:
        """See :meth:`.rounds.Members.draw`."""
        found, carried, inside = draw_round(self.source, missing, rounds_left)
        self.states.append(found[inside])
        self.coefficients.append(carried[inside])


def draw_round(
    source: MemberSource, members: int, rounds_left: float = 1.0
) -> tuple[Tensor, Tensor, Tensor]:
    """Simulate random members once, bounded or not.

    Args:
        source: what members are drawn from.
        members: number of trajectories.
        rounds_left: expected number of such rounds; many are worth a compilation.

    Returns:
        States ``(member, time, field, *grid)``, coefficients ``(member, term)``, and whether each
        member stays within bounds, ``(member,)``.
    """
    starts = source.prior.draw(members, source.rng)
    low, high = bounds(source.nominal, starts)
    forcing = source.forcing(members)
    found = simulate_members(
        source.system, starts, source.times, forcing, source.progress, rounds_left
    )
    return found, forcing.coefficients, stays_inside(found, low, high)


def stays_inside(states: Tensor, low: Tensor, high: Tensor) -> Tensor:
    """Return whether each trajectory is finite and within its bounds, ``(member,)``."""
    return (torch.isfinite(states) & (states >= low) & (states <= high)).flatten(1).all(dim=1)


def bounds(nominal: Tensor, starts: Tensor) -> tuple[Tensor, Tensor]:
    """Return the bounds of each member, ``(member, 1, field, *1)``.

    The start of a member may be far outside of a nominal simulation of small amplitude.
    """
    by_field, own = nominal.transpose(0, 1).flatten(1), starts.reshape(*starts.shape[:2], -1)
    low = torch.minimum(by_field.amin(dim=1), own.amin(dim=2))
    high = torch.maximum(by_field.amax(dim=1), own.amax(dim=2))
    # A field that is constant in the nominal simulation has no bounds.
    varies = by_field.amax(dim=1) > by_field.amin(dim=1)
    width = torch.where(varies, high - low, torch.inf)
    shape = (len(starts), 1, nominal.shape[1]) + (1,) * (nominal.dim() - 2)
    return (low - width).reshape(shape), (high + width).reshape(shape)
