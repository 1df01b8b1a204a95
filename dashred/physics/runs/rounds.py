"""Rounds of random simulations, until enough of them stay within bounds."""

from __future__ import annotations

from typing import Protocol

from dashred.core.budget import OutOfTimeError
from dashred.core.errors import InputError
from dashred.physics.external.failure import hint_of_failure
from dashred.physics.system import System

MAX_ROUNDS = 20
# Give up if, after this many rounds, less than this share of the members has been found.
EARLY_ROUNDS, MIN_EARLY_SHARE = 3, 0.1
# After the last round, or when the time is up, this share of the members is enough.
ENOUGH_SHARE = 0.5


class Members(Protocol):
    """The members of an ensemble that were found so far."""

    @property
    def count(self) -> int:
        """Their number."""

    def draw(self, missing: int, rounds_left: float) -> None:
        """Simulate random members once, and keep those that stay within bounds.

        Args:
            missing: number of members.
            rounds_left: expected number of rounds; many of them are worth a compilation.

        Raises:
            OutOfTimeError: the time is up.
        """


def draw_until_enough(found: Members, wanted: int, system: System) -> None:
    """Draw members in rounds; see :func:`.ensemble.draw_ensemble`.

    Raises:
        InputError, OutOfTimeError: see :func:`.ensemble.draw_ensemble`.
    """
    rounds, rounds_left = 0, 1.0
    for turn in range(MAX_ROUNDS):
        if turn == EARLY_ROUNDS and found.count < MIN_EARLY_SHARE * wanted:
            break
        before, missing = found.count, wanted - found.count
        try:
            found.draw(missing, rounds_left)
        except OutOfTimeError:
            if found.count < ENOUGH_SHARE * wanted:
                raise
            break
        rounds, rounds_left = rounds + 1, missing / max(1, found.count - before)
        if found.count == wanted:
            break
    if found.count < ENOUGH_SHARE * wanted:
        raise InputError(
            f"after {rounds} rounds only {found.count} of {wanted} simulations stay within bounds",
            where=system.where("system.spread"),
            hint=hint_of_failure(
                system.program, "make system.spread or simulation.amplitude smaller"
            ),
        )
