"""Draw the hidden effect of a case by kind, as the entry of a twin with relative sizes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from dashred.evaluation.proof.cases.systems import ProofSystem

# Difficulties of a third of the nulls, in which no physics is missing.
NUISANCES = ("correlated", "stated", "misplaced")
# Kinds of sensor faults that are drawn; a fixed list, so that earlier draws stay reproducible.
FAULTS = ("bias", "drift", "stuck", "spikes", "misplaced")


def _terms(proof_system: ProofSystem, rng: np.random.Generator) -> dict[str, Any]:
    """Draw a law of one to three terms in any equations."""
    every = _pairs(proof_system.terms)
    count = int(rng.choice([1, 2, 3], p=[0.5, 0.35, 0.15]))
    chosen = rng.choice(len(every), size=count, replace=False)
    return {"terms": [_term(*every[int(j)], rng) for j in chosen]}


def _in_the_hidden_equation(proof_system: ProofSystem, rng: np.random.Generator) -> dict[str, Any]:
    assert proof_system.hidden is not None
    term = str(rng.choice(proof_system.terms[proof_system.hidden]))
    return {"terms": [_term(proof_system.hidden, term, rng)]}


def _box(proof_system: ProofSystem, rng: np.random.Generator) -> dict[str, Any]:
    axis, length = proof_system.axis
    width = length * rng.uniform(0.15, 0.45)
    begin = rng.uniform(0.0, length - width)
    edge = length * rng.uniform(0.01, 0.03)
    return _in_window(proof_system.local, {axis: [begin, begin + width], "edge": edge}, rng)


def _onset(proof_system: ProofSystem, rng: np.random.Generator) -> dict[str, Any]:
    begin = proof_system.duration * rng.uniform(0.2, 0.55)
    edge = proof_system.duration * rng.uniform(0.005, 0.03)
    return _in_window(proof_system.local, {"t": [begin, None], "edge": edge}, rng)


def _gate(proof_system: ProofSystem, rng: np.random.Generator) -> dict[str, Any]:
    of, low, high = proof_system.gated
    threshold = round_to_three(rng.uniform(low, high))
    bounds = [threshold, None] if rng.random() < 0.5 else [None, threshold]
    window = {of: bounds, "edge": (high - low) * rng.uniform(0.03, 0.12)}
    return _in_window(proof_system.switched, window, rng)


def _in_window(
    terms: Mapping[str, Sequence[str]], window: dict[str, Any], rng: np.random.Generator
) -> dict[str, Any]:
    entry = _term(*_one_of(terms, rng), rng)
    ends = {key: _rounded_ends(value) for key, value in window.items()}
    return {"terms": [entry | {"window": ends}]}


def _outside(proof_system: ProofSystem, rng: np.random.Generator) -> dict[str, Any]:
    """Draw a term outside the library of the analysis, with random constants."""
    equation, form = _one_of(proof_system.beyond, rng)
    text = form.format(
        a=round_to_three(rng.uniform(1.2, 3.2)), p=round_to_three(rng.uniform(0.0, 6.28))
    )
    return {"terms": [_term(equation, text, rng)]}


def _parameter(proof_system: ProofSystem, rng: np.random.Generator) -> dict[str, Any]:
    """Draw a parameter and the sign of its error; the effect determines the size."""
    name = str(rng.choice(proof_system.parameters))
    return {"parameters": {name: _sign(rng)}}


def _fault(proof_system: ProofSystem, rng: np.random.Generator) -> dict[str, Any]:
    """Draw a fault of unit effect; its sensor is chosen once the sensors are placed."""
    kind = str(rng.choice(FAULTS))
    return {"faults": [{"sensor": float(rng.random()), "kind": kind, "value": _sign(rng)}]}


def draw_masked(proof_system: ProofSystem, rng: np.random.Generator) -> dict[str, Any]:
    """Draw a law with a sensor fault, with a compensating parameter, or of faint effect."""
    variant = int(rng.integers(3))
    law = {"terms": [_term(*_one_of(proof_system.terms, rng), rng)]}
    if variant == 0:
        return law | {"masked_by": str(rng.choice(proof_system.parameters))}
    return law | _fault(proof_system, rng) if variant == 1 else law


def draw_nuisance(
    proof_system: ProofSystem, key: tuple[int, ...], rng: np.random.Generator
) -> dict[str, Any]:
    """Draw the difficulty of one in three nulls; empty for the others."""
    seed, group, number = key[:3]
    block, place = divmod(number, 3)
    if np.random.default_rng([seed, group, block]).integers(3) != place:
        return {}
    kind = NUISANCES[block % len(NUISANCES)]
    if kind == "correlated":
        return {"correlation": round_to_three(rng.uniform(0.3, 0.6))}
    if kind == "stated":
        return {"stated": float(rng.choice([0.9, 1.1]))}
    distance = 0.0025 * proof_system.axis[1] * _sign(rng)
    fault = {"sensor": float(rng.random()), "kind": "misplaced", "value": distance}
    return {"faults": [fault]}


DRAW = {
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
    """Return all pairs of equation and term."""
    return [(equation, term) for equation in terms for term in terms[equation]]


def _one_of(terms: Mapping[str, Sequence[str]], rng: np.random.Generator) -> tuple[str, str]:
    every = _pairs(terms)
    return every[int(rng.integers(len(every)))]


def _term(equation: str, term: str, rng: np.random.Generator) -> dict[str, Any]:
    """Return a term whose coefficient is a relative share of the tendency of its equation."""
    share = _sign(rng) * log_uniform(rng, 0.7, 1.4)
    return {"equation": equation, "term": term, "coefficient": share}


def _sign(rng: np.random.Generator) -> float:
    return float(rng.choice([-1.0, 1.0]))


def log_uniform(rng: np.random.Generator, low: float, high: float) -> float:
    """Draw a number whose logarithm is uniform."""
    return float(np.exp(rng.uniform(np.log(low), np.log(high))))


def round_to_three(value: float) -> float:
    """Round to three significant digits."""
    return float(f"{value:.3g}")


def _rounded_ends(value: Any) -> Any:
    if isinstance(value, list):
        return [None if end is None else round_to_three(end) for end in value]
    return round_to_three(value)
