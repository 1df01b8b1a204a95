"""What a proof does, as its page says it."""

from __future__ import annotations

from dataclasses import dataclass

from dashred.evaluation.proof.cases.identifiability import CLEAR
from dashred.evaluation.proof.cases.oracle import DECIDABLE
from dashred.evaluation.proof.cases.systems import SYSTEMS


@dataclass(frozen=True)
class ProtocolFacts:
    """How this draw came to be: what no case's record knows.

    Attributes:
        commit: hash of the code under test; None of a draw for practice.
        draw: what the seed of the draw was made of.
        seed: of the draw.
        cases: how many were drawn.
        nulls: how many were drawn apart.
        hours: that all took, on the clock.
        processes: that ran side by side.
        drawn_again: how many cases gave way to others, whose law can be foreseen to be told.
        scored_by: commit that scored the draw again; None where it was scored as it was analysed.
    """

    commit: str | None
    draw: str
    seed: int
    cases: int
    nulls: int
    hours: float
    processes: int
    drawn_again: int
    scored_by: str | None


def protocol(facts: ProtocolFacts, finished: int) -> dict[str, object]:
    """Return what the protocol of one draw says, of whose cases so many are finished."""
    return {
        "facts": facts,
        "finished": finished,
        "effects": _effects(),
        "noises": _noises(),
        "clear": f"{CLEAR:g}",
        "decidable": f"{DECIDABLE:g}",
    }


def _noises() -> str:
    """Return the ranges of noise by system."""
    return ", ".join(
        f"`{proved.name}` {100 * low:g} to {100 * high:g} %"
        for proved in SYSTEMS.values()
        for low, high in [proved.noise]
    )


def _effects() -> str:
    """Return the ranges of effects by system."""
    ranges = [
        f"{low:g} to {high:g} (`{proved.name}`)"
        for proved in SYSTEMS.values()
        if proved.share is None
        for low, high in [proved.effect]
    ]
    return " or ".join(ranges)
