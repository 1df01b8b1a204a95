"""Draw the cases: what is hidden in each, and how it is recorded.

All comes from one number, the seed of the draw, which the hash of the commit under test gives: no
method can have been tuned to it. Only how large the hidden effect is in the sensors needs a
simulation, and is settled when the case is recorded.
"""

from __future__ import annotations

import hashlib
import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from dashred.evaluation.proof.cases.case_record import Kind
from dashred.evaluation.proof.cases.hidden_causes import (
    HIDE,
    log_uniform,
    masked,
    nuisance,
    rounded,
)
from dashred.evaluation.proof.cases.systems import SYSTEMS, Proved

# Kinds of cases by system, dealt out over and over, each time in another order.
DECKS: dict[str, tuple[Kind, ...]] = {
    "fhn": (
        *("terms", "fault", "hidden", "box", "parameter", "outside", "gate", "terms", "start"),
        *("onset", "fault", "masked", "null", "box", "terms", "numerics", "hidden", "parameter"),
        *("gate", "fault", "outside", "start", "onset", "terms", "masked", "fault", "hidden"),
        *("box", "parameter", "terms"),
    ),
    "ks1d": (
        *("terms", "fault", "box", "terms", "parameter", "null", "numerics", "outside", "gate"),
        *("start", "terms", "onset"),
    ),
    "rde": (
        *("terms", "hidden", "parameter", "fault", "terms", "box", "null", "outside", "start"),
        *("gate", "numerics"),
    ),
}
# Systems of the cases, and of the nulls, dealt out likewise.
TABLES = {
    "cases": ("fhn", "fhn", "rde", "fhn", "fhn", "ks1d", "fhn", "rde", "fhn", "fhn"),
    "nulls": (*("fhn",) * 9, "rde"),
}
# Of masked cases: below what a single sample shows.
FAINT = (0.7, 1.0)


@dataclass(frozen=True)
class Case:
    """One case.

    Attributes:
        number: in its group.
        group: ``cases`` or ``nulls``.
        system: its name.
        kind: what is hidden.
        key: of its random streams.
        noise: share of each trace's std.
        sensors: number of fit sensors.
        hidden: a twin's entry, its coefficients relative to each other alone.
        effect: rms over the sensors in units of the noise that what is hidden shall have; None
            where the entry is final.
        share: its size, where that is drawn and not the effect.
        words: of the analysis, beside the recording.
    """

    number: int
    group: str
    system: str
    kind: Kind
    key: tuple[int, ...]
    noise: float
    sensors: int
    hidden: dict[str, Any]
    effect: float | None
    share: float | None = None
    words: tuple[str, ...] = ()

    def stream(self, of: str) -> np.random.Generator:
        """Return the random stream of one of its draws: none can shift another's."""
        return np.random.default_rng([*self.key, *of.encode()])

    @property
    def analysis_seed(self) -> int:
        """The seed that the analysis is handed: it says nothing of the case."""
        return int(self.stream("analysis").integers(2**31))

    @property
    def analysis_words(self) -> tuple[str, ...]:
        """The words of its analysis, but for the system and where recording and results are."""
        return (*SYSTEMS[self.system].analysis, *self.words, f"seed={self.analysis_seed}")

    def __str__(self) -> str:
        """``case 17``, ``null 3``."""
        return f"{self.group.removesuffix('s')} {self.number}"


def seed_of(text: str) -> int:
    """Return the seed that a commit's hash, or any text, gives."""
    return int.from_bytes(hashlib.sha256(text.encode()).digest()[:8])


def draw_cases(seed: int, cases: int, nulls: int) -> list[Case]:
    """Return the cases, then the nulls; the first of them do not depend on how many there are."""
    found = []
    for group, count in (("cases", cases), ("nulls", nulls)):
        table = TABLES[group]
        dealt: dict[str, int] = {}
        for number in range(count):
            system = table[number % len(table)]
            turn = dealt.get(system, 0)
            dealt[system] = turn + 1
            kind = _dealt(seed, system, turn) if group == "cases" else "null"
            key = (seed, list(TABLES).index(group), number)
            found.append(_draw(SYSTEMS[system], group, number, kind, key))
    return found


def draw_again(case: Case, times: int) -> Case:
    """Return another case in the place of one, of the same kind, when it was drawn so many times.

    Args:
        case: as it was drawn first, or later.
        times: how often already: every time has streams of its own.
    """
    key = (*case.key[:3], times)
    return _draw(SYSTEMS[case.system], case.group, case.number, case.kind, key)


def _dealt(seed: int, system: str, turn: int) -> Kind:
    """Return the kind of a system's next case: no order tells it beforehand."""
    deck = DECKS[system]
    again, place = divmod(turn, len(deck))
    order = np.random.default_rng([seed, again, *system.encode()]).permutation(len(deck))
    return deck[order[place]]


def _draw(proved: Proved, group: str, number: int, kind: Kind, key: tuple[int, ...]) -> Case:
    rng = np.random.default_rng([*key, *b"what"])
    noise = rounded(log_uniform(rng, *proved.noise))
    sensors = int(rng.integers(proved.sensors[0], proved.sensors[1] + 1))
    effect: float | None = float(log_uniform(rng, *_sizes(kind, proved.effect)))
    words: tuple[str, ...] = ()
    hidden: dict[str, Any] = {"terms": []}
    if kind == "null":
        effect = None
        if group == "nulls":
            hidden |= nuisance(proved, key, rng)
    elif kind == "start":
        effect = None
        hidden["spread"] = rounded(rng.uniform(*proved.starts))
    elif kind == "numerics":
        effect, words = None, (str(rng.choice(proved.coarse)),)
    elif kind == "masked":
        hidden |= masked(proved, rng)
        if len(hidden) == 1:
            effect = float(log_uniform(rng, *FAINT))
    else:
        hidden |= HIDE[kind](proved, rng)
    return Case(
        number=number,
        group=group,
        system=proved.name,
        kind=kind,
        key=key,
        noise=noise,
        sensors=sensors,
        hidden=hidden,
        effect=effect,
        share=_share(proved, kind, rng) if effect is not None else None,
        words=words,
    )


def _share(proved: Proved, kind: Kind, rng: np.random.Generator) -> float | None:
    return None if proved.share is None else log_uniform(rng, *_sizes(kind, proved.share))


def _sizes(kind: Kind, known: tuple[float, float]) -> tuple[float, float]:
    """Return the range of a kind's sizes.

    A gate is open in states that are alike: what a term does there another does as well, unless it
    is large. So they are of the upper half.
    """
    low, high = known
    return (math.sqrt(low * high), high) if kind == "gate" else known
