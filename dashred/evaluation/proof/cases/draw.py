"""Draw the cases: their hidden effects and their recordings.

Everything follows from the seed of the draw, which is the hash of the commit under test, so that no
method can be tuned to it. Only the size of the hidden effect at the sensors needs a simulation; it
is determined when the case is recorded.
"""

from __future__ import annotations

import hashlib
import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from dashred.evaluation.proof.cases.case_record import Kind
from dashred.evaluation.proof.cases.hidden_causes import (
    DRAW,
    draw_masked,
    draw_nuisance,
    log_uniform,
    round_to_three,
)
from dashred.evaluation.proof.cases.systems import SYSTEMS, ProofSystem

# Kinds of cases by system. They are repeated, each time in a new random order.
KIND_DECKS: dict[str, tuple[Kind, ...]] = {
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
# Systems of the cases and of the nulls, repeated in this order.
SYSTEM_CYCLES = {
    "cases": ("fhn", "fhn", "rde", "fhn", "fhn", "ks1d", "fhn", "rde", "fhn", "fhn"),
    "nulls": (*("fhn",) * 9, "rde"),
}
# Effect of faint masked cases: below the noise of a single sample.
FAINT_EFFECT = (0.7, 1.0)


@dataclass(frozen=True)
class Case:
    """One case. The names of its attributes determine its hash in ``case.json``.

    Attributes:
        number: number in its group.
        group: ``cases`` or ``nulls``.
        system: name of the system.
        kind: kind of the hidden effect.
        key: key of its random streams.
        noise: noise as a share of the std of each trace.
        sensors: number of fit sensors.
        hidden: entry of a twin, with relative coefficients.
        effect: wanted rms of the hidden effect at the sensors, in units of the noise; None if the
            entry is final.
        share: size of the hidden effect if it is drawn instead of `effect`.
        words: arguments of the analysis besides the recording.
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
        """Return the random stream of one of its draws; the streams are independent."""
        return np.random.default_rng([*self.key, *of.encode()])

    @property
    def analysis_seed(self) -> int:
        """Seed of the analysis; it contains no information about the case."""
        return int(self.stream("analysis").integers(2**31))

    @property
    def analysis_words(self) -> tuple[str, ...]:
        """Arguments of its analysis, without the system and the paths of recording and results."""
        return (*SYSTEMS[self.system].analysis, *self.words, f"seed={self.analysis_seed}")

    def __str__(self) -> str:
        """``case 17``, ``null 3``."""
        return f"{self.group.removesuffix('s')} {self.number}"


def seed_of(text: str) -> int:
    """Return the seed derived from the hash of a commit or from any text."""
    return int.from_bytes(hashlib.sha256(text.encode()).digest()[:8])


def draw_cases(seed: int, cases: int, nulls: int) -> list[Case]:
    """Return the cases, then the nulls; the first ones do not depend on their number."""
    drawn = []
    for group, count in (("cases", cases), ("nulls", nulls)):
        cycle = SYSTEM_CYCLES[group]
        counts: dict[str, int] = {}
        for number in range(count):
            system = cycle[number % len(cycle)]
            turn = counts.get(system, 0)
            counts[system] = turn + 1
            kind = _next_kind(seed, system, turn) if group == "cases" else "null"
            key = (seed, list(SYSTEM_CYCLES).index(group), number)
            drawn.append(_draw(SYSTEMS[system], group, number, kind, key))
    return drawn


def redraw(case: Case, times: int) -> Case:
    """Return another case of the same kind in place of a rejected one.

    Args:
        case: the rejected case.
        times: number of draws so far; it selects the random streams.
    """
    key = (*case.key[:3], times)
    return _draw(SYSTEMS[case.system], case.group, case.number, case.kind, key)


def _next_kind(seed: int, system: str, turn: int) -> Kind:
    """Return the kind of the next case of a system, in a random order."""
    deck = KIND_DECKS[system]
    repeat, position = divmod(turn, len(deck))
    order = np.random.default_rng([seed, repeat, *system.encode()]).permutation(len(deck))
    return deck[order[position]]


def _draw(
    proof_system: ProofSystem, group: str, number: int, kind: Kind, key: tuple[int, ...]
) -> Case:
    rng = np.random.default_rng([*key, *b"what"])
    noise = round_to_three(log_uniform(rng, *proof_system.noise))
    sensors = int(rng.integers(proof_system.sensors[0], proof_system.sensors[1] + 1))
    effect: float | None = float(log_uniform(rng, *_sizes(kind, proof_system.effect)))
    words: tuple[str, ...] = ()
    hidden: dict[str, Any] = {"terms": []}
    if kind == "null":
        effect = None
        if group == "nulls":
            hidden |= draw_nuisance(proof_system, key, rng)
    elif kind == "start":
        effect = None
        hidden["spread"] = round_to_three(rng.uniform(*proof_system.starts))
    elif kind == "numerics":
        effect, words = None, (str(rng.choice(proof_system.coarse)),)
    elif kind == "masked":
        hidden |= draw_masked(proof_system, rng)
        if len(hidden) == 1:
            effect = float(log_uniform(rng, *FAINT_EFFECT))
    else:
        hidden |= DRAW[kind](proof_system, rng)
    return Case(
        number=number,
        group=group,
        system=proof_system.name,
        kind=kind,
        key=key,
        noise=noise,
        sensors=sensors,
        hidden=hidden,
        effect=effect,
        share=_share(proof_system, kind, rng) if effect is not None else None,
        words=words,
    )


def _share(proof_system: ProofSystem, kind: Kind, rng: np.random.Generator) -> float | None:
    return (
        None if proof_system.share is None else log_uniform(rng, *_sizes(kind, proof_system.share))
    )


def _sizes(kind: Kind, known: tuple[float, float]) -> tuple[float, float]:
    """Return the range of sizes of a kind.

    A gate is open in similar states, in which small terms cannot be told apart. Its sizes are
    therefore from the upper half of the range.
    """
    low, high = known
    return (math.sqrt(low * high), high) if kind == "gate" else known
