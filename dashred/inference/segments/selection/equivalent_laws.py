"""Merge laws that the recording cannot distinguish; the plainest of them is reported."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from dashred.inference.segments.segments import Array
from dashred.inference.segments.selection.law_tendency import law_tendency
from dashred.inference.segments.selection.search import SegmentSearch
from dashred.inference.segments.selection.set_selection import SegmentLaw
from dashred.physics.expressions.algebra import Call, Expr, Power, Where, children

# Laws whose tendencies differ by less than this share over the record, and whose scores differ by
# less than this, are equivalent.
TENDENCY_SHARE, SCORE_MARGIN = 0.05, 6.0
# These functions are plainer than sines and exponentials, and less plain than polynomials.
PIECEWISE = frozenset({"abs", "sign", "step"})


def merge_equivalent(search: SegmentSearch) -> SegmentSearch:
    """Return the search with one law for each group of equivalent ones near the best.

    The plainest law of a group stays, with the best score of the group.
    """
    near = [law for law in search.laws if law.score < search.best.score + SCORE_MARGIN]
    tendencies = {law.members: _tendency(search, law) for law in near}
    kept: list[SegmentLaw] = []
    remaining = list(near)
    while remaining:
        first, *others = remaining
        reference = tendencies[first.members]
        bound = TENDENCY_SHARE * np.linalg.norm(reference)
        group = [
            law for law in others if np.linalg.norm(tendencies[law.members] - reference) < bound
        ]
        plainest = min([first, *group], key=lambda law: _complexity(search, law))
        kept.append(replace(plainest, score=first.score))
        remaining = [law for law in others if all(law is not member for member in group)]
    return replace(search, laws=[*kept, *search.laws[len(near) :]])


def _tendency(search: SegmentSearch, law: SegmentLaw) -> Array:
    """Return what a law adds to the equations at the best law's nodes, in units of their rates."""
    nodes = search.best.fit.point.nodes
    found = law_tendency(search.problem.simulator, nodes, *search.terms(law))
    scaled: Array = found / search.natural.rate
    return scaled


def _complexity(search: SegmentSearch, law: SegmentLaw) -> tuple[int, int, int]:
    """Return the sort key of a law: number of terms, special functions, length of the text."""
    chosen, _ = search.terms(law)
    expressions = [term.expression for candidate in chosen for term in candidate.terms]
    special = sum(map(_speciality, expressions))
    return len(law.members), special, sum(len(str(expr)) for expr in expressions)


def _speciality(expr: Expr) -> int:
    """Return 0 for a polynomial, and more for each other power or function."""
    own = 0
    if isinstance(expr, Call):
        own = 1 if expr.function in PIECEWISE else 2
    elif isinstance(expr, Where):
        own = 1
    elif isinstance(expr, Power):
        own = 0 if _is_natural(expr.exponent) else 1
    return own + sum(map(_speciality, children(expr)))


def _is_natural(exponent: Expr) -> bool:
    value = getattr(exponent, "value", None)
    return isinstance(value, float) and value >= 0 and value == round(value)
