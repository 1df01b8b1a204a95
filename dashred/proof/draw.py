"""Draw the cases: what is hidden in each, and how it is recorded.

All comes from one number, the seed of the draw, which the hash of the commit under test gives: no
method can have been tuned to it. Only how large the hidden effect is in the sensors needs a
simulation, and is settled when the case is recorded.
"""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from typing import Any

import numpy as np

from dashred.proof.case_record import Kind
from dashred.proof.systems import SYSTEMS, Proved

# Kinds of cases by system, dealt out over and over, each time in another order.
DECKS: dict[str, tuple[Kind, ...]] = {
    "fhn": (
        *("terms", "fault", "hidden", "box", "parameter", "outside", "gate", "terms", "start"),
        *("onset", "fault", "masked", "null", "box", "terms", "numerics", "hidden", "parameter"),
        *("gate", "fault", "outside", "start", "onset", "terms", "masked", "fault", "hidden"),
        *("box", "parameter", "terms"),
    ),
    "ks1d": (
        *("terms", "fault", "box", "terms", "parameter", "null", "terms", "outside", "fault"),
        *("start", "terms", "onset"),
    ),
    "rde": ("terms", "hidden", "parameter", "fault", "terms", "box", "null", "outside", "start"),
}
# Systems of the cases, and of the nulls, dealt out likewise.
TABLES = {
    "cases": ("fhn", "fhn", "rde", "fhn", "fhn", "ks1d", "fhn", "rde", "fhn", "fhn"),
    "nulls": (*("fhn",) * 9, "rde"),
}
# What a third of the nulls suffer from without anything being missing.
NUISANCES = ("correlated", "stated", "misplaced")
FAULTS = ("bias", "drift", "stuck", "spikes", "misplaced")
# Of masked cases: below what a single sample shows.
FAINT = (0.5, 1.0)


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


def _dealt(seed: int, system: str, turn: int) -> Kind:
    """Return the kind of a system's next case: no order tells it beforehand."""
    deck = DECKS[system]
    again, place = divmod(turn, len(deck))
    order = np.random.default_rng([seed, again, *system.encode()]).permutation(len(deck))
    return deck[order[place]]


def _draw(proved: Proved, group: str, number: int, kind: Kind, key: tuple[int, ...]) -> Case:
    rng = np.random.default_rng([*key, *b"what"])
    noise = _rounded(_log_uniform(rng, *proved.noise))
    sensors = int(rng.integers(proved.sensors[0], proved.sensors[1] + 1))
    effect: float | None = float(_log_uniform(rng, *proved.effect))
    words: tuple[str, ...] = ()
    hidden: dict[str, Any] = {"terms": []}
    if kind == "null":
        effect = None
        if group == "nulls":
            hidden |= _nuisance(proved, key, rng)
    elif kind == "start":
        effect = None
        hidden["spread"] = _rounded(rng.uniform(3.0, 6.0))
    elif kind == "numerics":
        effect, words = None, (str(rng.choice(proved.coarse)),)
    elif kind == "masked":
        hidden |= _masked(proved, rng)
        if len(hidden) == 1:
            effect = float(_log_uniform(rng, *FAINT))
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
        share=None if effect is None or proved.share is None else _log_uniform(rng, *proved.share),
        words=words,
    )


def _terms(proved: Proved, rng: np.random.Generator) -> dict[str, Any]:
    """Return a law of one to three terms, of whatever equations."""
    every = [(equation, term) for equation in proved.terms for term in proved.terms[equation]]
    count = int(rng.choice([1, 2, 3], p=[0.5, 0.35, 0.15]))
    chosen = rng.choice(len(every), size=count, replace=False)
    return {"terms": [_term(*every[int(j)], rng) for j in chosen]}


def _in_the_hidden_equation(proved: Proved, rng: np.random.Generator) -> dict[str, Any]:
    assert proved.hidden is not None
    term = str(rng.choice(proved.terms[proved.hidden]))
    return {"terms": [_term(proved.hidden, term, rng)]}


def _box(proved: Proved, rng: np.random.Generator) -> dict[str, Any]:
    axis, length = proved.axis
    width = length * rng.uniform(0.15, 0.45)
    begin = rng.uniform(0.0, length - width)
    edge = length * rng.uniform(0.01, 0.03)
    return _in_window(proved, {axis: [begin, begin + width], "edge": edge}, rng)


def _onset(proved: Proved, rng: np.random.Generator) -> dict[str, Any]:
    begin = proved.duration * rng.uniform(0.2, 0.55)
    edge = proved.duration * rng.uniform(0.005, 0.03)
    return _in_window(proved, {"t": [begin, None], "edge": edge}, rng)


def _gate(proved: Proved, rng: np.random.Generator) -> dict[str, Any]:
    of, low, high = proved.gated
    threshold = _rounded(rng.uniform(low, high))
    bounds = [threshold, None] if rng.random() < 0.5 else [None, threshold]
    return _in_window(proved, {of: bounds, "edge": (high - low) * rng.uniform(0.03, 0.12)}, rng)


def _in_window(proved: Proved, window: dict[str, Any], rng: np.random.Generator) -> dict[str, Any]:
    every = [(equation, term) for equation in proved.local for term in proved.local[equation]]
    entry = _term(*every[int(rng.integers(len(every)))], rng)
    ends = {key: _rounded_ends(value) for key, value in window.items()}
    return {"terms": [entry | {"window": ends}]}


def _outside(proved: Proved, rng: np.random.Generator) -> dict[str, Any]:
    """Return a law of a term that the analysis' library lacks, its constants drawn, too."""
    every = [(equation, form) for equation in proved.beyond for form in proved.beyond[equation]]
    equation, form = every[int(rng.integers(len(every)))]
    text = form.format(a=_rounded(rng.uniform(1.2, 3.2)), p=_rounded(rng.uniform(0.0, 6.28)))
    return {"terms": [_term(equation, text, rng)]}


def _parameter(proved: Proved, rng: np.random.Generator) -> dict[str, Any]:
    """Return the share by which a parameter is off; how much, the effect decides."""
    name = str(rng.choice(proved.parameters))
    return {"parameters": {name: float(rng.choice([-1.0, 1.0]))}}


def _fault(proved: Proved, rng: np.random.Generator) -> dict[str, Any]:
    """Return a fault of an effect of one on a sensor that is drawn when there are some."""
    kind = str(rng.choice(FAULTS))
    return {"faults": [{"sensor": float(rng.random()), "kind": kind, "value": _sign(rng)}]}


def _masked(proved: Proved, rng: np.random.Generator) -> dict[str, Any]:
    """Return a law beside a parameter or a fault that hides it, or a law that is faint alone."""
    how = int(rng.integers(3))
    every = [(equation, term) for equation in proved.terms for term in proved.terms[equation]]
    law = {"terms": [_term(*every[int(rng.integers(len(every)))], rng)]}
    if how == 0:
        return law | _parameter(proved, rng)
    return law | _fault(proved, rng) if how == 1 else law


def _nuisance(proved: Proved, key: tuple[int, ...], rng: np.random.Generator) -> dict[str, Any]:
    """Return what one of every three nulls suffers from."""
    seed, group, number = key
    block, place = divmod(number, 3)
    if np.random.default_rng([seed, group, block]).integers(3) != place:
        return {}
    kind = NUISANCES[block % len(NUISANCES)]
    if kind == "correlated":
        return {"correlation": _rounded(rng.uniform(0.3, 0.6))}
    if kind == "stated":
        return {"stated": float(rng.choice([0.9, 1.1]))}
    distance = 0.0025 * proved.axis[1] * _sign(rng)
    fault = {"sensor": float(rng.random()), "kind": "misplaced", "value": distance}
    return {"faults": [fault]}


HIDE = {
    "terms": _terms,
    "hidden": _in_the_hidden_equation,
    "box": _box,
    "onset": _onset,
    "gate": _gate,
    "outside": _outside,
    "parameter": _parameter,
    "fault": _fault,
}


def _term(equation: str, term: str, rng: np.random.Generator) -> dict[str, Any]:
    """Return a term; its coefficient is a share of the equation's tendency, between its like."""
    share = _sign(rng) * _log_uniform(rng, 0.5, 2.0)
    return {"equation": equation, "term": term, "coefficient": share}


def _sign(rng: np.random.Generator) -> float:
    return float(rng.choice([-1.0, 1.0]))


def _log_uniform(rng: np.random.Generator, low: float, high: float) -> float:
    return float(np.exp(rng.uniform(np.log(low), np.log(high))))


def _rounded(value: float) -> float:
    return float(f"{value:.3g}")


def _rounded_ends(value: Any) -> Any:
    if isinstance(value, list):
        return [None if end is None else _rounded(end) for end in value]
    return _rounded(value)
