"""An ensemble of the simulator: random starts and, by default, random discrepancies."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np
import torch
from torch import Tensor

from dashred.core.errors import InputError
from dashred.physics.library import evaluate_terms, resolve
from dashred.physics.solvers.forcing import Forcing
from dashred.physics.solvers.simulate import Progress, simulate
from dashred.physics.system import System, Term

MOST_ROUNDS = 20
# Where so few of the members are found in so many rounds, the others will not be found at all.
TELLING_ROUNDS, TELLING_SHARE = 3, 0.1


class Starts(Protocol):
    """Where members start, at random.

    :class:`dashred.physics.runs.initial_state_prior.StartPrior` is one.
    """

    def draw(self, count: int, rng: np.random.Generator) -> Tensor:
        """Return ``count`` random starts, ``(count, field, *grid)``."""


@dataclass(frozen=True)
class Ensemble:
    """Trajectories of the simulator with the terms that each member carries.

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
    """How random model errors are drawn: so many library terms a member.

    Each has ``ξ_j ~ N(0, amplitude² s_j²)`` with ``s_j = rms(∂u/∂t)/rms(θ_j)`` over the nominal
    simulation, so that its tendency is about ``amplitude`` of the equation's own.

    A decoder trained on the plain simulation cannot express the real field; one trained on
    simulations that are each a little wrong can (design §4.1). Only the library is used, so
    nothing about the real discrepancy enters.
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
        t: time of all of them, or of each, ``(time,)``.
    """
    tendencies = [Term(f, system.equations[f]) for f in system.fields]
    rms = evaluate_terms(system, tendencies, nominal, t).flatten(1).pow(2).mean(1).sqrt()
    columns = evaluate_terms(system, library, nominal, t).flatten(1).pow(2).mean(1).sqrt()
    of_equation = [system.fields.index(term.equation) for term in library]
    return rms[of_equation] / columns.clamp(min=1e-12)


def draw_ensemble(
    system: System,
    times: Tensor,
    prior: Starts,
    nominal: Tensor,
    members: int,
    discrepancies: Discrepancies | None,
    rng: np.random.Generator,
    progress: Progress | None = None,
) -> Ensemble:
    """Simulate ``members`` random members that stay plausible.

    A member that blows up, or leaves the nominal simulation's range by more than its width,
    is drawn anew: a negative damping has no bound, and one such member would set every scale.

    Args:
        system: the simulator.
        times: output times, on the recording's clock.
        prior: draws the starts.
        nominal: the nominal simulation, ``(time, field, *grid)``, for scales and ranges.
        members: how many trajectories.
        discrepancies: random model errors; None for a plain ensemble.
        rng: the only source of chance.
        progress: called with the fraction done of each round of simulations.

    Raises:
        InputError: hardly any draw stays bounded.
    """
    states: list[Tensor] = []
    coefficients: list[Tensor] = []
    for turn in range(MOST_ROUNDS):
        missing = members - sum(map(len, states))
        if turn == TELLING_ROUNDS and members - missing < TELLING_SHARE * members:
            break
        drawn = draw_round(system, times, prior, nominal, missing, discrepancies, rng, progress)
        found, carried, inside = drawn
        states.append(found[inside])
        coefficients.append(carried[inside])
        if sum(map(len, states)) == members:
            return Ensemble(times, torch.cat(states), torch.cat(coefficients))
    raise InputError(
        f"after {len(states)} rounds only {sum(map(len, states))} of {members} simulations "
        "stay within bounds",
        where=system.where("system.spread"),
        hint="make system.spread or simulation.amplitude smaller",
    )


def draw_round(
    system: System,
    times: Tensor,
    prior: Starts,
    nominal: Tensor,
    members: int,
    discrepancies: Discrepancies | None,
    rng: np.random.Generator,
    progress: Progress | None = None,
) -> tuple[Tensor, Tensor, Tensor]:
    """Simulate random members once, plausible or not; arguments as :func:`draw_ensemble` has them.

    Returns:
        states ``(member, time, field, *grid)``, coefficients ``(member, term)``, and which of the
        members stay within bounds, ``(member,)``.
    """
    low, high = _bounds(nominal)
    starts = prior.draw(members, rng)
    forcing = _draw_forcing(system, nominal, discrepancies, members, rng, times)
    found = simulate(system, starts, times, forcing, progress)
    inside = (torch.isfinite(found) & (found >= low) & (found <= high)).flatten(1).all(dim=1)
    return found, forcing.coefficients, inside


def _bounds(nominal: Tensor) -> tuple[Tensor, Tensor]:
    by_field = nominal.transpose(0, 1).flatten(1)
    low, high = by_field.amin(dim=1), by_field.amax(dim=1)
    # A field at rest in the nominal simulation says nothing about how far it may move.
    width = torch.where(high > low, high - low, torch.inf)
    shape = (-1,) + (1,) * (nominal.dim() - 2)
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
