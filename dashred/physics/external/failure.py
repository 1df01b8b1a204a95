"""What a program said when it failed, for the errors that follow from it."""

from __future__ import annotations

from dashred.physics.external.protocol import Program


def hint_of_failure(program: Program | None, otherwise: str) -> str:
    """Return what a program last failed with, or else another hint."""
    if program is None or program.failure is None:
        return otherwise
    return f"the simulator may be the reason: {program.failure}"
