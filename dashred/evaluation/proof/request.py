"""What one command of the proof asks for."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path


@dataclass(frozen=True)
class Request:
    """What one command asks for.

    Attributes:
        cases: how many that hide something.
        nulls: how many more that do not.
        jobs: cases at once.
        output: folder of the cases.
        document: file of the result.
        pendulum: a real recording; None for no appendix.
        draw: what the seed of the draw is made of.
        practice: whether that is another text than the commit's hash.
        scored_by: commit that scores a kept draw again; None of one that is to be analysed.
    """

    cases: int
    nulls: int
    jobs: int
    output: Path
    document: Path
    pendulum: Path | None
    draw: str
    practice: bool
    scored_by: str | None = None
