"""The settings of one proof command."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from dashred.core.cluster.word import Cluster


@dataclass(frozen=True)
class Request:
    """Settings of one command.

    Attributes:
        cases: number of cases.
        nulls: number of nulls.
        jobs: number of parallel analyses.
        output: folder of the cases.
        document: path of the document.
        pendulum: recording of a real pendulum; None for no appendix.
        draw: text from which the seed is derived.
        practice: whether the text is not the hash of the commit.
        cluster: where the analyses run; None for this machine.
        scored_by: commit that rescores an existing draw; None for a new draw.
    """

    cases: int
    nulls: int
    jobs: int
    output: Path
    document: Path
    pendulum: Path | None
    draw: str
    practice: bool
    cluster: Cluster | None = None
    scored_by: str | None = None
