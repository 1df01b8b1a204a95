"""What a term does to a field, in plain words: ``linear damping of vorticity``.

The words follow from the shape of the term and the sign of its coefficient alone, so they hold
for any system; what no rule covers gets a sentence that is dull and correct.
"""

from __future__ import annotations

import math
from collections.abc import Mapping

from dashred.core.units import TIME, with_unit
from dashred.inference.wording.sized_term import SizedTerm, meaning
from dashred.inference.wording.spatial_wording import spatial_words, steep_words
from dashred.physics.expressions.algebra import ONE, Call, Expr, Name, split_coefficient
from dashred.physics.system import System

DEGREES = {1: "linear", 2: "quadratic", 3: "cubic", 4: "quartic", 5: "quintic"}


def words(system: System, equation: str, expr: Expr, value: float, std: float) -> str:
    """Return what ``value*expr`` in an equation does, with its size.

    Args:
        system: gives fields their meaning.
        equation: the field whose rate of change the term is part of.
        expr: the term, coefficient aside.
        value: its coefficient.
        std: standard deviation of that.
    """
    term = SizedTerm(system, equation, expr, value, std)
    for rule in (_constant, _periodic, steep_words, spatial_words, _drag, _restoring, _monomial):
        if found := rule(term):
            return found
    return f"a change of {term.what} by {term.amount}"


def _constant(term: SizedTerm) -> str | None:
    if term.expr != ONE:
        return None
    return f"constant {'source' if term.value > 0 else 'sink'} of {term.what}, {term.amount}"


def _periodic(term: SizedTerm) -> str | None:
    match term.expr:
        case Call("sin" | "cos", inner):
            frequency, clock = split_coefficient(inner)
            if clock == Name("t"):
                length = f"{2 * math.pi / abs(frequency):.3g}"
                period = f"a period of {with_unit(length, term.system.units.get(TIME))}"
                return f"periodic drive of {term.what}, with {period}: {term.amount}"
    return None


def _drag(term: SizedTerm) -> str | None:
    own = Name(term.equation)
    if term.expr == Call("sign", own):
        moving, else_ = ("dry friction", "constant push along the motion"), "of constant size"
    elif set(term.factors) == {own, Call("abs", own)}:
        moving, else_ = ("quadratic drag", "quadratic thrust"), "(quadratic, of either sign)"
    else:
        return None
    grows = term.value > 0
    if term.is_velocity:
        return f"{moving[grows]} on {term.what}, {term.amount}"
    return f"{'growth' if grows else 'damping'} {else_} of {term.what}, {term.amount}"


def _restoring(term: SizedTerm) -> str | None:
    for position in term.positions:
        pulls = term.value < 0
        if term.expr == Name(position):
            kind = "restoring force, as of a spring" if pulls else "force away from zero"
            return f"linear {kind}, on {term.what}: {term.amount}"
        if term.expr == Call("sin", Name(position)):
            kind = "stronger" if pulls else "weaker"
            return f"{kind} restoring force, as of gravity, on {term.what}: {term.amount}"
    return None


def _monomial(term: SizedTerm) -> str | None:
    powers = term.powers()
    if not powers:
        return None
    own = powers.pop(term.equation, 0)
    change = "damping" if term.value < 0 else "growth"
    if not own:
        kind = "linear coupling" if sum(powers.values()) == 1 else "coupling"
        does = "lowers" if term.value < 0 else "raises"
        note = f"({does} it{_where(powers)})"
        return f"{kind} of {_others(term, powers)} into {term.what} {note}, {term.amount}"
    degree = DEGREES.get(own, f"{own}th-power")
    # An even power damps on one side of zero and drives away on the other.
    side = {term.equation: 1} if own % 2 == 0 else {}
    if powers:
        change = change if own == 1 else f"{degree} {change}"
        return (
            f"coupling: {change} of {term.what} in proportion to {_others(term, powers)}"
            f"{_where(side | powers)}, {term.amount}"
        )
    if own == 1:
        viscous = term.value < 0 and term.is_velocity
        kind = "viscous damping" if viscous else f"linear {change}"
        return f"{kind} of {term.what}, {term.amount_alone}"
    note = " (saturation)" if term.value < 0 and not side else ""
    return f"{degree} {change} of {term.what}{_where(side)}{note}, {term.amount}"


def _others(term: SizedTerm, powers: Mapping[str, int]) -> str:
    raised = {1: "", 2: " squared", 3: " cubed"}
    return " and ".join(
        meaning(term.system, field) + raised.get(n, f" to the {n}th power")
        for field, n in powers.items()
    )


def _where(powers: Mapping[str, int]) -> str:
    """`` where lam > 0``: on which side of zero a product of fields has the sign that is told."""
    odd = [field for field, n in powers.items() if n % 2]
    return f" where {'*'.join(odd)} > 0".replace("*", "·") if odd else ""
