"""Ensembles of simulations with random initial states and random discrepancies."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np
import torch
from torch import Tensor

from dashred.core.budget import OutOfTimeError
from dashred.core.errors import InputError
from dashred.physics.external.failure import hint_of_failure
from dashred.physics.runs.members import simulate_members
from dashred.physics.runs.tendency_size import tendency_size
from dashred.physics.solvers.forcing import Forcing
from dashred.physics.solvers.simulate import Progress
from dashred.physics.system import System, Term
from dashred.physics.terms.library import evaluate_terms, resolve

MAX_ROUNDS = 20
# Give up if, after this many rounds, less than this share of the members has been found.
EARLY_ROUNDS, MIN_EARLY_SHARE = 3, 0.1
# After the last round, or when the time is up, this share of the members is enough.
ENOUGH_SHARE = 0.5


class StartDistribution(Protocol):
    """Distribution of the members' initial states, such as ``StartPrior``."""

    def draw(self, count: int, rng: np.random.Generator) -> Tensor:
        """Return ``count`` random initial states, ``(count, field, *grid)``."""


@dataclass(frozen=True)
class Ensemble:
    """Simulated trajectories with the coefficients of each member's random terms.

    Attributes:
        times: ``(time,)``, on the recording's clock.
        states: ``(member, time, field, *grid)``, float64.
        coefficients: ``(member, term)``; all zero for a plain ensemble.
    """

    times: Tensor
    states: Tensor
    coefficients: Tensor


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
        terms: number of terms for each member.
        amplitude: relative size of their tendencies.
    """

    library: Sequence[Term]
    terms: int
    amplitude: float


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
    columns = evaluate_terms(system, library, nominal, t).flatten(1).pow(2).mean(1).sqrt()
    of_equation = [system.fields.index(term.equation) for term in library]
    return rms[of_equation] / columns.clamp(min=1e-12)


def draw_ensemble(
    system: System,
    times: Tensor,
    prior: StartDistribution,
    nominal: Tensor,
    members: int,
    discrepancies: Discrepancies | None,
    rng: np.random.Generator,
    progress: Progress | None = None,
) -> Ensemble:
    """Simulate random members that stay bounded.

    A member that blows up, or leaves the range of the nominal simulation and of its own start by
    more than the width of this range, is drawn again: a single diverging member would dominate
    every scale. If members are still missing after the last round, or when the time is up, half of
    them are enough.

    Args:
        system: the simulator.
        times: output times, on the recording's clock.
        prior: distribution of the initial states.
        nominal: the nominal simulation, ``(time, field, *grid)``, for scales and ranges.
        members: number of trajectories.
        discrepancies: random model errors; None for a plain ensemble.
        rng: random number generator.
        progress: called with the fraction done of each round of simulations.

    Raises:
        InputError: too few members stay bounded.
        OutOfTimeError: raised by ``progress`` before there were enough members.
    """
    states: list[Tensor] = []
    coefficients: list[Tensor] = []
    count, rounds_left = 0, 1.0
    for turn in range(MAX_ROUNDS):
        if turn == EARLY_ROUNDS and count < MIN_EARLY_SHARE * members:
            break
        try:
            found, carried, inside = draw_round(
                system,
                times,
                prior,
                nominal,
                members - count,
                discrepancies,
                rng,
                progress,
                rounds_left,
            )
        except OutOfTimeError:
            if count < ENOUGH_SHARE * members:
                raise
            break
        states.append(found[inside])
        coefficients.append(carried[inside])
        count += len(states[-1])
        rounds_left = len(inside) / max(1, len(states[-1]))
        if count == members:
            break
    if count < ENOUGH_SHARE * members:
        raise InputError(
            f"after {len(states)} rounds only {count} of {members} simulations stay within bounds",
            where=system.where("system.spread"),
            hint=hint_of_failure(
                system.program, "make system.spread or simulation.amplitude smaller"
            ),
        )
    return Ensemble(times, torch.cat(states), torch.cat(coefficients))


def draw_round(
    system: System,
    times: Tensor,
    prior: StartDistribution,
    nominal: Tensor,
    members: int,
    discrepancies: Discrepancies | None,
    rng: np.random.Generator,
    progress: Progress | None = None,
    rounds_left: float = 1.0,
) -> tuple[Tensor, Tensor, Tensor]:
    """Simulate random members once, bounded or not; arguments as in :func:`draw_ensemble`.

    Many rounds are worth a compilation; ``rounds_left`` is their expected number.

    Returns:
        States ``(member, time, field, *grid)``, coefficients ``(member, term)``, and whether each
        member stays within bounds, ``(member,)``.
    """
    starts = prior.draw(members, rng)
    low, high = _bounds(nominal, starts)
    forcing = _draw_forcing(system, nominal, discrepancies, members, rng, times)
    found = simulate_members(system, starts, times, forcing, progress, rounds_left)
    inside = (torch.isfinite(found) & (found >= low) & (found <= high)).flatten(1).all(dim=1)
    return found, forcing.coefficients, inside


def _bounds(nominal: Tensor, starts: Tensor) -> tuple[Tensor, Tensor]:
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


def _draw_forcing(
    system: System,
    nominal: Tensor,
    discrepancies: Discrepancies | None,
    members: int,
    rng: np.random.Generator,
    times: Tensor,
) -> Forcing:
    if discrepancies is None:
        return Forcing((), torch.zeros((members, 0), dtype=torch.float64))
    library = discrepancies.library
    if discrepancies.terms > len(library):
        raise InputError(
            f"simulation.terms asks for {discrepancies.terms} terms out of {len(library)}",
            where=system.where("simulation.terms"),
        )
    known = min(len(nominal), len(times))
    scales = term_scales(system, library, nominal[:known], times[:known])
    coefficients = np.zeros((members, len(library)))
    for row in coefficients:
        chosen = rng.choice(len(library), size=discrepancies.terms, replace=False)
        row[chosen] = discrepancies.amplitude * rng.standard_normal(len(chosen))
    return Forcing(resolve(system, library), torch.from_numpy(coefficients) * scales)
