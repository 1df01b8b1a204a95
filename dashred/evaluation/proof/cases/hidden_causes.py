"""What a case of each kind hides, drawn: as a twin's entry, its sizes still relative."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from dashred.evaluation.proof.cases.systems import Proved
from dashred.evaluation.twins.twin_file import FAULTS

# What a third of the nulls suffer from without anything being missing.
NUISANCES = ("correlated", "stated", "misplaced")


def _terms(proved: Proved, rng: np.random.Generator) -> dict[str, Any]:
    """Return a law of one to three terms, of whatever equations."""
    every = _pairs(proved.terms)
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
    return _in_window(proved.local, {axis: [begin, begin + width], "edge": edge}, rng)


def _onset(proved: Proved, rng: np.random.Generator) -> dict[str, Any]:
    begin = proved.duration * rng.uniform(0.2, 0.55)
    edge = proved.duration * rng.uniform(0.005, 0.03)
    return _in_window(proved.local, {"t": [begin, None], "edge": edge}, rng)


def _gate(proved: Proved, rng: np.random.Generator) -> dict[str, Any]:
    of, low, high = proved.gated
    threshold = rounded(rng.uniform(low, high))
    bounds = [threshold, None] if rng.random() < 0.5 else [None, threshold]
    window = {of: bounds, "edge": (high - low) * rng.uniform(0.03, 0.12)}
    return _in_window(proved.switched, window, rng)


def _in_window(
    terms: Mapping[str, Sequence[str]], window: dict[str, Any], rng: np.random.Generator
) -> dict[str, Any]:
    entry = _term(*_one_of(terms, rng), rng)
    ends = {key: _rounded_ends(value) for key, value in window.items()}
    return {"terms": [entry | {"window": ends}]}


def _outside(proved: Proved, rng: np.random.Generator) -> dict[str, Any]:
    """Return a law of a term that the analysis' library lacks, its constants drawn, too."""
    equation, form = _one_of(proved.beyond, rng)
    text = form.format(a=rounded(rng.uniform(1.2, 3.2)), p=rounded(rng.uniform(0.0, 6.28)))
    return {"terms": [_term(equation, text, rng)]}


def _parameter(proved: Proved, rng: np.random.Generator) -> dict[str, Any]:
    """Return the share by which a parameter is off; how much, the effect decides."""
    name = str(rng.choice(proved.parameters))
    return {"parameters": {name: _sign(rng)}}


def _fault(proved: Proved, rng: np.random.Generator) -> dict[str, Any]:
    """Return a fault of an effect of one on a sensor that is drawn when there are some."""
    kind = str(rng.choice(FAULTS))
    return {"faults": [{"sensor": float(rng.random()), "kind": kind, "value": _sign(rng)}]}


def masked(proved: Proved, rng: np.random.Generator) -> dict[str, Any]:
    """Return a law beside a fault, or behind a parameter that makes up for it, or faint."""
    how = int(rng.integers(3))
    law = {"terms": [_term(*_one_of(proved.terms, rng), rng)]}
    if how == 0:
        return law | {"masked_by": str(rng.choice(proved.parameters))}
    return law | _fault(proved, rng) if how == 1 else law


def nuisance(proved: Proved, key: tuple[int, ...], rng: np.random.Generator) -> dict[str, Any]:
    """Return what one of every three nulls suffers from."""
    seed, group, number = key
    block, place = divmod(number, 3)
    if np.random.default_rng([seed, group, block]).integers(3) != place:
        return {}
    kind = NUISANCES[block % len(NUISANCES)]
    if kind == "correlated":
        return {"correlation": rounded(rng.uniform(0.3, 0.6))}
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


def _pairs(terms: Mapping[str, Sequence[str]]) -> list[tuple[str, str]]:
    """Return every equation with each of its terms."""
    return [(equation, term) for equation in terms for term in terms[equation]]


def _one_of(terms: Mapping[str, Sequence[str]], rng: np.random.Generator) -> tuple[str, str]:
    every = _pairs(terms)
    return every[int(rng.integers(len(every)))]


def _term(equation: str, term: str, rng: np.random.Generator) -> dict[str, Any]:
    """Return a term; its coefficient is a share of the equation's tendency, between its like."""
    share = _sign(rng) * log_uniform(rng, 0.7, 1.4)
    return {"equation": equation, "term": term, "coefficient": share}


def _sign(rng: np.random.Generator) -> float:
    return float(rng.choice([-1.0, 1.0]))


def log_uniform(rng: np.random.Generator, low: float, high: float) -> float:
    """Draw a number whose logarithm is uniform."""
    return float(np.exp(rng.uniform(np.log(low), np.log(high))))


def rounded(value: float) -> float:
    """Return a number to three digits, as it is told."""
    return float(f"{value:.3g}")


def _rounded_ends(value: Any) -> Any:
    if isinstance(value, list):
        return [None if end is None else rounded(end) for end in value]
    return rounded(value)
