"""The same law in another unit of a field that no sensor reads.

If no sensor reads v, then ``w = a v`` gives the same readings. A term ``c v^d (…)`` of another
equation becomes ``c a^-d w^d (…)``, and one of v's own equation becomes ``c a^(1-d) w^d (…)``. In
another unit than that of the simulator, a law needs further terms, which change the simulator's own
terms of v. A fit of the plainer law that begins at these states may get stuck, because all states
of v have to change.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from dashred.inference.segments.gauss_newton import NodeFit
from dashred.inference.segments.point import Point
from dashred.inference.segments.selection.candidate_sets import Set
from dashred.inference.segments.weak_constraint import WeakConstraintProblem
from dashred.physics.expressions.algebra import Expr, split_coefficient
from dashred.physics.expressions.monomials import degree, products

Key = tuple[str, Expr]
"""An equation, and a product without its number."""

# A change of a coefficient by less than this share of the larger of the two values is none, and a
# coefficient below this share of the simulator's own is zero.
SMALLEST = 0.1
# Units beyond this factor, or its inverse, are those of a coefficient that is nearly zero.
LARGEST_UNIT = 1e3


class RescaledLaw(NamedTuple):
    """A law in another unit of a field.

    Attributes:
        field: index of the field.
        unit: a; the states of the field are multiplied by it.
        members: indices of the law's candidates, sorted.
        point: where its fit may begin.
    """

    field: int
    unit: float
    members: Set
    point: Point


class _Monomial(NamedTuple):
    """A product of the law, or of the simulator.

    Attributes:
        own: its coefficient in the simulator.
        whole: its coefficient in the simulator with the law.
        power: whole becomes ``whole / a**power`` in the new unit.
    """

    own: float
    whole: float
    power: int


def rescaled_laws(
    problem: WeakConstraintProblem, members: Set, fit: NodeFit
) -> Iterator[RescaledLaw]:
    """Yield smaller laws that give the same readings, the smallest first.

    In the unit of such a law, a term of the simulator that the law changes has its own coefficient
    again.

    Args:
        problem: F.
        members: indices of the law's candidates.
        fit: of the law.
    """
    [system, *_] = problem.simulator.systems
    candidates = {
        key: (j, factor) for j in range(problem.count) for key, factor in _keys(problem, j)
    }
    law = {key: (j, factor) for key, (j, factor) in candidates.items() if j in members}
    is_plain = len(law) == len(members) and not problem.parameters.candidates
    if not is_plain or system.program is not None:
        return
    own: dict[Key, float] = {}
    for equation, expr in system.resolved.items():
        for product in products(expr):
            value, rest = split_coefficient(product)
            own[equation, rest] = own.get((equation, rest), 0.0) + value
    whole = own | {
        key: own.get(key, 0.0) + factor * float(fit.point.xi[j]) for key, (j, factor) in law.items()
    }
    found = []
    for place, name in enumerate(system.fields):
        monomials = None if name in problem.sensors.names_read else _monomials(own, whole, name)
        if monomials is None:
            continue
        for unit in _units([monomials[key] for key in law]):
            xi = _in_unit(monomials, candidates, unit)
            if xi is not None and len(xi) < len(members):
                found.append((place, unit, xi))
    for place, unit, xi in sorted(found, key=lambda each: len(each[2])):
        nodes, coefficients = fit.point.nodes.copy(), np.zeros_like(fit.point.xi)
        nodes[:, place] *= unit
        coefficients[list(xi)] = list(xi.values())
        moved = replace(fit.point, nodes=nodes, xi=coefficients)
        yield RescaledLaw(place, unit, tuple(sorted(xi)), moved)


def _keys(problem: WeakConstraintProblem, index: int) -> list[tuple[Key, float]]:
    """Return the product of a candidate and its number; nothing if it is no product."""
    candidate = problem.candidates[index]
    if candidate.equation is None or len(candidate.terms) != 1:
        return []
    [term] = candidate.terms
    factor, rest = split_coefficient(term.expression)
    return [((term.equation, rest), factor)]


def _monomials(
    own: dict[Key, float], whole: dict[Key, float], name: str
) -> dict[Key, _Monomial] | None:
    """Return all products; None if one of them is no power of the field."""
    found = {}
    for key, value in whole.items():
        equation, expr = key
        exponent = degree(expr, name)
        if exponent is None:
            return None
        found[key] = _Monomial(own.get(key, 0.0), value, exponent - (equation == name))
    return found


def _units(changed: list[_Monomial]) -> list[float]:
    """Return the units a in which a changed term has the simulator's own coefficient."""
    units: list[float] = []
    for own, whole, power in changed:
        if power == 0 or own == 0 or abs(whole) < SMALLEST * abs(own):
            continue
        ratio = whole / own
        size = abs(ratio) ** (1 / power)
        signed = [math.copysign(size, ratio)] if power % 2 else [size, -size] if ratio > 0 else []
        for unit in signed:
            is_new = all(abs(unit / other - 1) > SMALLEST for other in units)
            if is_new and 1 / LARGEST_UNIT < size < LARGEST_UNIT:
                units.append(unit)
    return units


def _in_unit(
    monomials: dict[Key, _Monomial], candidates: dict[Key, tuple[int, float]], unit: float
) -> dict[int, float] | None:
    """Return the coefficients of the law by candidate; None if the library lacks a term of it."""
    found = {}
    for key, (own, whole, power) in monomials.items():
        value = whole / unit**power
        # Where the unit plays no part, the law keeps its terms, however small they are.
        smallest = SMALLEST * max(abs(value), abs(own)) if power else 0.0
        if abs(value - own) <= smallest:
            continue
        if key not in candidates:
            return None
        index, factor = candidates[key]
        found[index] = (value - own) / factor
    return found
