"""The protocol: the code is tagged, and the cases follow from the hash of the tagged commit."""

from __future__ import annotations

import subprocess
from collections.abc import Sequence

from dashred.core.command_line.arguments import COMMAND_LINE
from dashred.core.errors import InputError
from dashred.evaluation.foreign.cases.case import Case, Collection, Kind
from dashred.evaluation.foreign.cases.field_equations import FIELD_EQUATIONS
from dashred.evaluation.foreign.cases.mechanisms import MECHANISMS
from dashred.evaluation.foreign.cases.published_problems import (
    KS_NOISE,
    KS_PROBLEMS,
    LORENZ_NOISE,
    LORENZ_PROBLEMS,
)
from dashred.evaluation.isolation.worker import CHECKOUT
from dashred.evaluation.proof.cases.draw import seed_of

# What is hidden in the draws of one system, in order. Every second source pulsates.
FIELD_KINDS: tuple[Kind, ...] = (
    *("term", "source", "source", "region", "sensor"),
    *("nothing", "term", "sensor", "term", "nothing"),
)
MECHANICS_KINDS: tuple[Kind, ...] = ("term", "term", "sensor", "term", "nothing")


def draw_cases(draw: str, dysts: Sequence[str], noise: Sequence[float], draws: int) -> list[Case]:
    """Return all cases of a draw.

    The fields and the mechanisms are drawn at the first noise only, and the problems of other
    papers at the paper's.

    Args:
        draw: text that gives the seed: the hash of the commit.
        dysts: names of the polynomial systems.
        noise: std of the noise as a share of that of each reading.
        draws: number of draws of each polynomial system at each noise.
    """
    seed = seed_of(draw)
    terms: tuple[Kind, ...] = tuple("term" for _ in range(draws))
    plan: list[tuple[Collection, Sequence[str], tuple[Kind, ...], float]] = [
        *(("dysts", dysts, terms, each) for each in noise),
        ("fields", list(FIELD_EQUATIONS), FIELD_KINDS, noise[0]),
        ("mechanics", list(MECHANISMS), MECHANICS_KINDS, noise[0]),
        *(("published", list(LORENZ_PROBLEMS), terms, each) for each in LORENZ_NOISE),
        ("published", list(KS_PROBLEMS), ("term",), KS_NOISE),
    ]
    return [
        Case(collection, system, kind, number, share, seed)
        for collection, systems, kinds, share in plan
        for number, kind in enumerate(kinds)
        for system in systems
    ]


def commit_of_tag(tag: str) -> str:
    """Return the hash of the commit of a tag of this checkout.

    Raises:
        InputError: there is no such tag.
    """
    command = ["git", "rev-parse", "--verify", "--quiet", f"refs/tags/{tag}^{{commit}}"]
    try:
        ended = subprocess.run(
            command, cwd=CHECKOUT, capture_output=True, text=True, check=True, timeout=10
        )
    except (OSError, subprocess.SubprocessError, ValueError):
        raise InputError(
            f"this checkout has no tag {tag}",
            where=COMMAND_LINE,
            hint="tag the commit under test first: git tag NAME; or practise with draw=TEXT",
        ) from None
    return ended.stdout.strip()
