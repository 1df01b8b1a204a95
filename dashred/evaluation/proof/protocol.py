"""Facts of the protocol section of the document."""

from __future__ import annotations

from dataclasses import dataclass

from dashred.evaluation.proof.cases.identifiability import CLEAR_MARGIN
from dashred.evaluation.proof.cases.oracle import DECIDABLE
from dashred.evaluation.proof.cases.systems import SYSTEMS


@dataclass(frozen=True)
class ProtocolFacts:
    """Facts about a draw that the records of its cases do not contain.

    Attributes:
        commit: hash of the code under test; None for a practice draw.
        draw: text from which the seed is derived.
        seed: seed of the draw.
        cases: number of cases.
        nulls: number of nulls.
        hours: wall-clock hours.
        processes: number of parallel processes.
        drawn_again: number of redraws.
        scored_by: commit that rescored the draw; None if it has not been rescored.
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
    """Return the values of the protocol template.

    Args:
        facts: facts about the draw.
        finished: number of finished cases.
    """
    return {
        "facts": facts,
        "finished": finished,
        "effects": _effects(),
        "noises": _noises(),
        "clear": f"{CLEAR_MARGIN:g}",
        "decidable": f"{DECIDABLE:g}",
    }


def _noises() -> str:
    """Return the ranges of noise by system."""
    return ", ".join(
        f"`{proof_system.name}` {100 * low:g} to {100 * high:g} %"
        for proof_system in SYSTEMS.values()
        for low, high in [proof_system.noise]
    )


def _effects() -> str:
    """Return the ranges of effects by system."""
    ranges = [
        f"{low:g} to {high:g} (`{proof_system.name}`)"
        for proof_system in SYSTEMS.values()
        if proof_system.share is None
        for low, high in [proof_system.effect]
    ]
    return " or ".join(ranges)
