"""Compare a reported law with the hidden tendency."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from dashred.evaluation.foreign.cases.case import Array, TrueTerm, Truth
from dashred.evaluation.foreign.scoring.added_tendency import (
    added_tendencies,
    box_mask,
    region_mask,
)
from dashred.physics.expressions import algebra
from dashred.physics.expressions.algebra import Expr
from dashred.physics.system import System

# Largest rms of the difference to the hidden tendency, as a share of its rms.
TOLERANCE = 0.1
# Largest half width of an interval that may contain the truth, as a share of the coefficient.
WIDEST_INTERVAL = 0.3
# Smallest intersection over union of a told and a hidden region.
OVERLAP = 0.5
# Share of the axis at both ends of a hidden region in which its term rises to its full size.
EDGE = 0.03


def is_exact(system: System, entries: Sequence[Mapping[str, Any]], truth: Truth) -> bool:
    """Return whether a law adds the hidden tendency, in each equation, and nothing else.

    An entry is something else if the law without it is as good. A law with more entries than the
    hidden one has products imitates it. A law of the true terms, with coefficients within the
    tolerance, is exact as well: the term of dry friction has no value while a slider sticks.
    """
    if truth.terms and len(entries) > sum(term.size for term in truth.terms):
        return False
    if truth.kind == "region":
        return _is_exact_in_region(system, entries, truth)
    parts = added_tendencies(system, entries, truth)
    if parts is None:
        return False
    return _has_true_terms(system, entries, truth) or _adds(parts, truth.hidden)


def _has_true_terms(system: System, entries: Sequence[Mapping[str, Any]], truth: Truth) -> bool:
    """Return whether a law has the true terms, with coefficients within the tolerance."""
    if not truth.terms or any(
        entry["equation"] is None or entry.get("region") for entry in entries
    ):
        return False
    terms = [TrueTerm(e["equation"], str(e["term"]), float(e["coefficient"])) for e in entries]
    told, known = (_summed(system, each) for each in (terms, truth.terms))
    return told.keys() == known.keys() and all(
        abs(told[key] - value) <= TOLERANCE * abs(value) for key, value in known.items()
    )


def _is_exact_in_region(system: System, entries: Sequence[Mapping[str, Any]], truth: Truth) -> bool:
    """Return whether a law acts in the hidden region, and as the hidden term where both act.

    They are compared where the hidden term has its full size, not at its smooth edges. The
    coefficients have to be within the tolerance, or their intervals have to contain the truth.
    """
    assert truth.region is not None
    if not entries or not all(entry.get("region") for entry in entries):
        return False
    shape = (len(truth.times), *truth.states.shape[2:])
    axis, (begin, end) = system.axes[0], truth.region
    true = np.broadcast_to(box_mask(system, axis.name, truth.region), shape)
    for entry in entries:
        told = region_mask(system, entry["region"][0], truth)
        if (true * told).sum() < OVERLAP * np.maximum(true, told).sum():
            return False
    edge = EDGE * axis.length
    inner = np.broadcast_to(box_mask(system, axis.name, (begin + edge, end - edge)), shape)
    both = np.prod(
        [inner, *(region_mask(system, r, truth) for e in entries for r in e["region"])], axis=0
    )
    parts = added_tendencies(system, entries, truth)
    if parts is None:
        return False
    inside, hidden = [part * both[:, None] for part in parts], truth.hidden * both[:, None]
    return _adds(inside, hidden) or _adds(_within_intervals(entries, inside, hidden), hidden)


def _within_intervals(
    entries: Sequence[Mapping[str, Any]], parts: Sequence[Array], hidden: Array
) -> list[Array]:
    """Return the parts with the coefficients that fit the hidden tendency best.

    A coefficient moves only within its 95 % interval, and only if this is narrow. The strength of a
    term in a region and the width of the region compensate each other.
    """
    columns = np.stack([part.ravel() for part in parts], axis=1)
    factors = np.linalg.lstsq(columns, hidden.ravel(), rcond=None)[0]
    moved = []
    for entry, part, factor in zip(entries, parts, factors.tolist(), strict=True):
        low, high = sorted(entry.get("ci95") or (0.0, 0.0))
        coefficient = float(entry["coefficient"] or 0.0)
        is_narrow = high - low <= 2 * WIDEST_INTERVAL * abs(coefficient)
        moved.append(factor * part if is_narrow and low <= factor * coefficient <= high else part)
    return moved


def _adds(parts: Sequence[Array], hidden: Array) -> bool:
    """Return whether parts ``(time, field, *grid)`` sum up to the hidden tendency, all needed."""
    total = sum(parts, np.zeros_like(hidden))
    if not parts or not _near(total, hidden):
        return False
    return not any(_near(total - part, hidden) for part in parts)


def _near(found: Array, hidden: Array) -> bool:
    error, size = (np.sqrt(np.mean(v**2, axis=_all_but_field(v))) for v in (found - hidden, hidden))
    return bool((error <= TOLERANCE * size).all())


def _all_but_field(values: Array) -> tuple[int, ...]:
    return (0, *range(2, values.ndim))


def covered(system: System, entries: Sequence[Mapping[str, Any]], truth: Truth) -> list[bool]:
    """Return for each told term of the true law whether its 95 % interval has the true value."""
    known, found = _summed(system, truth.terms), []
    for entry in entries:
        if entry["equation"] is None or not entry.get("ci95"):
            continue
        unit = TrueTerm(str(entry["equation"]), str(entry["term"]), 1.0)
        summands = list(_coefficients(system, unit))
        if len(summands) == 1 and summands[0][0] in known:
            [(key, factor)] = summands
            low, high = sorted(factor * float(end) for end in entry["ci95"])
            found.append(low <= known[key] <= high)
    return found


def _summed(system: System, terms: Sequence[TrueTerm]) -> dict[tuple[str, Expr], float]:
    """Return the coefficients of terms by equation and expression."""
    known: dict[tuple[str, Expr], float] = {}
    for term in terms:
        for key, value in _coefficients(system, term):
            known[key] = known.get(key, 0.0) + value
    return known


def _coefficients(system: System, term: TrueTerm) -> list[tuple[tuple[str, Expr], float]]:
    """Return the summands of a term, each by equation and expression, with its coefficient."""
    parsed = system.resolve(system.parse(term.term, "terms", equation=term.equation), "terms")
    scaled = algebra.scale(term.coefficient, parsed)
    split = [algebra.split_coefficient(summand) for summand in algebra.summands(scaled)]
    return [((term.equation, expression), value) for value, expression in split]
