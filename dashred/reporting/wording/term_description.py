"""Describe the physical effect of a term, such as ``linear damping of vorticity``.

The rules use only the form of the term and the sign of its coefficient, so they apply to any
system. A term that matches no rule is described by its expression.
"""

from __future__ import annotations

import math
from collections.abc import Mapping

from dashred.core.formatting import joined, with_error
from dashred.core.units import TIME, with_unit
from dashred.physics.expressions.algebra import (
    ONE,
    Call,
    Expr,
    Name,
    add,
    names,
    scale,
    split_coefficient,
)
from dashred.physics.hidden_state import followed_by
from dashred.physics.system import System
from dashred.physics.terms.let_terms import equations_with_let
from dashred.physics.terms.term_units import coefficient_unit
from dashred.reporting.wording.sized_term import (
    Description,
    SizedTerm,
    format_expression,
    meaning,
)
from dashred.reporting.wording.spatial_wording import describe_spatial, describe_squared_gradient

DEGREES = {1: "linear", 2: "quadratic", 3: "cubic", 4: "quartic", 5: "quintic"}


def describe_term(
    system: System, equation: str, expr: Expr, value: float, std: float
) -> Description:
    """Describe the effect of ``value·expr`` in the equation of a field, or in a let.

    Args:
        system: defines the fields, their meanings and units.
        equation: the field whose rate of change contains the term, or the let.
        expr: the term without its coefficient.
        value: the coefficient.
        std: its standard deviation.
    """
    if equation in system.lets:
        return _describe_in_let(system, equation, expr, value, std)
    sized = SizedTerm(system, equation, expr, value, std)
    rules = (
        _memory,
        _constant,
        _periodic,
        describe_squared_gradient,
        describe_spatial,
        _drag,
        _restoring,
        _monomial,
    )
    for rule in rules:
        if result := rule(sized):
            return result
    return Description(f"a further change of {sized.field_meaning}", sized.text, " by ")


def _describe_in_let(system: System, let: str, expr: Expr, value: float, std: float) -> Description:
    readers = equations_with_let(system, let)
    noun = "equation" if len(readers) == 1 else "equations"
    size = with_unit(with_error(value, std), coefficient_unit(system, let, expr))
    text = size if expr == ONE else f"({size})·{format_expression(expr)}"
    return Description(f"a change of {let} in the {noun} of {joined(readers)}", text, " by ")


def _memory(term: SizedTerm) -> Description | None:
    """Describe a term with a hidden state by what this state follows."""
    for field in names(term.expr) & set(term.system.fields):
        follows = followed_by(term.system, field)
        if follows is not None and term.expr in (Name(field), *_differences(field, follows)):
            if follows == term.equation:
                return Description(f"a memory of {term.field_meaning}", term.text, ": ")
            of = meaning(term.system, follows) if follows in term.system.fields else follows
            return Description(f"a memory of {of} in {term.field_meaning}", term.text, ": ")
    return None


def _differences(field: str, follows: str) -> list[Expr]:
    pairs = ((field, follows), (follows, field))
    return [add([Name(first), scale(-1.0, Name(second))]) for first, second in pairs]


def _constant(term: SizedTerm) -> Description | None:
    if term.expr != ONE:
        return None
    kind = "source" if term.value > 0 else "sink"
    return Description(f"constant {kind} of {term.field_meaning}", term.text)


def _periodic(term: SizedTerm) -> Description | None:
    match term.expr:
        case Call("sin" | "cos", inner):
            frequency, argument = split_coefficient(inner)
            if argument == Name("t"):
                length = f"{2 * math.pi / abs(frequency):.3g}"
                period = with_unit(length, term.system.units.get(TIME))
                effect = f"periodic forcing of {term.field_meaning} with a period of {period}"
                return Description(effect, term.text, ": ")
    return None


def _drag(term: SizedTerm) -> Description | None:
    own = Name(term.equation)
    if term.expr == Call("sign", own):
        effects, manner = (
            ("dry friction", "constant push along the motion"),
            "of constant size",
        )
    elif set(term.factors) == {own, Call("abs", own)}:
        effects, manner = (
            ("quadratic drag", "quadratic thrust"),
            "(quadratic, of either sign)",
        )
    else:
        return None
    grows = term.value > 0
    if term.is_velocity:
        return Description(f"{effects[grows]} on {term.field_meaning}", term.text)
    kind = "growth" if grows else "damping"
    return Description(f"{kind} {manner} of {term.field_meaning}", term.text)


def _restoring(term: SizedTerm) -> Description | None:
    for position in term.positions:
        pulls = term.value < 0
        if term.expr == Name(position):
            kind = "restoring force, as of a spring" if pulls else "force away from zero"
            return Description(f"linear {kind}, on {term.field_meaning}", term.text, ": ")
        if term.expr == Call("sin", Name(position)):
            kind = "stronger" if pulls else "weaker"
            effect = f"{kind} restoring force, as of gravity, on {term.field_meaning}"
            return Description(effect, term.text, ": ")
    return None


def _monomial(term: SizedTerm) -> Description | None:
    powers = term.powers()
    if not powers:
        return None
    own = powers.pop(term.equation, 0)
    change = "damping" if term.value < 0 else "growth"
    if not own:
        kind = "linear coupling" if sum(powers.values()) == 1 else "coupling"
        verb = "lowers" if term.value < 0 else "raises"
        effect = (
            f"{kind} of {_others(term, powers)} into {term.field_meaning} "
            f"({verb} it{_where(powers)})"
        )
        return Description(effect, term.text)
    degree = DEGREES.get(own, f"{own}th-power")
    # An even power damps on one side of zero and amplifies on the other.
    side = {term.equation: 1} if own % 2 == 0 else {}
    if powers:
        change = change if own == 1 else f"{degree} {change}"
        effect = (
            f"coupling: {change} of {term.field_meaning} in proportion to {_others(term, powers)}"
            f"{_where(side | powers)}"
        )
        return Description(effect, term.text)
    if own == 1:
        viscous = term.value < 0 and term.is_velocity
        kind = "viscous damping" if viscous else f"linear {change}"
        return Description(f"{kind} of {term.field_meaning}", term.coefficient_text)
    note = " (saturation)" if term.value < 0 and not side else ""
    return Description(f"{degree} {change} of {term.field_meaning}{_where(side)}{note}", term.text)


def _others(term: SizedTerm, powers: Mapping[str, int]) -> str:
    raised = {1: "", 2: " squared", 3: " cubed"}
    return " and ".join(
        meaning(term.system, field) + raised.get(n, f" to the {n}th power")
        for field, n in powers.items()
    )


def _where(powers: Mapping[str, int]) -> str:
    """Return the condition for the sign of a product of fields, such as `` where lam·u > 0``."""
    odd = [field for field, n in powers.items() if n % 2]
    return f" where {'·'.join(odd)} > 0" if odd else ""
