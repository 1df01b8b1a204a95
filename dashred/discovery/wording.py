"""What a term does to a field, in plain words: ``linear damping of vorticity``.

The words follow from the shape of the term and the sign of its coefficient alone, so they hold
for any system; what no rule covers gets a sentence that is dull and correct.
"""

from __future__ import annotations

import math
from collections.abc import Mapping

from dashred.discovery.spatial_shape import is_spatial, read_derivative
from dashred.physics import algebra
from dashred.physics.algebra import (
    ONE,
    Call,
    Derivative,
    Expr,
    Name,
    Number,
    Power,
    Product,
    split_coefficient,
)
from dashred.physics.system import System
from dashred.physics.term_units import coefficient_unit
from dashred.typeset import MINUS, pretty, with_error
from dashred.units import TIME, measured, shown

DEGREES = {1: "linear", 2: "quadratic", 3: "cubic", 4: "quartic", 5: "quintic"}


def meaning(system: System, field: str) -> str:
    """Return what a field means, its unit left out: ``angular velocity``."""
    return system.config.fields[field].split("(")[0].strip() or field


def words(system: System, equation: str, expr: Expr, value: float, std: float) -> str:
    """Return what ``value*expr`` in an equation does, with its size.

    Args:
        system: gives fields their meaning.
        equation: the field whose rate of change the term is part of.
        expr: the term, coefficient aside.
        value: its coefficient.
        std: standard deviation of that.
    """
    term = _Term(system, equation, expr, value, std)
    for rule in (_constant, _periodic, _steep, _spatial, _drag, _restoring, _monomial):
        if found := rule(term):
            return found
    return f"a change of {term.what} by {term.amount}"


class _Term:
    """One term, taken apart."""

    def __init__(self, system: System, equation: str, expr: Expr, value: float, std: float) -> None:
        self.system, self.equation, self.expr = system, equation, expr
        self.value, self.std = value, std
        self.what = meaning(system, equation)
        self.factors = expr.factors if isinstance(expr, Product) else (expr,)
        self.unit = coefficient_unit(system, equation, expr)

    @property
    def amount(self) -> str:
        """``(−0.0251 ± 0.0004)·u³ per unit time``, ``(0.12 ± 0.01 rad/s²)·sin(theta)``."""
        if self.expr == ONE:
            return self.amount_alone
        product = f"({self.size()})·{_print(self.expr)}"
        return product if self.unit else f"{product} {self.rate}"

    @property
    def amount_alone(self) -> str:
        """The same without the expression: ``−0.0251 ± 0.0004 per s``."""
        return self.size() if self.unit else f"{self.size()} {self.rate}"

    @property
    def rate(self) -> str:
        """What a rate of change is per."""
        unit = self.system.units.get(TIME)
        return f"per {shown(unit) if unit else 'unit time'}"

    def size(self, factor: float = 1.0) -> str:
        """Return the coefficient with its error, times a number, and its unit where it is known."""
        size = with_error(factor * self.value, abs(factor) * self.std)
        return measured(size, self.unit)

    @property
    def is_velocity(self) -> bool:
        """Whether the field is the velocity of another: ``theta' = omega``."""
        return bool(self.positions)

    @property
    def positions(self) -> list[str]:
        """The fields whose rate of change this field is."""
        equations = self.system.equations
        return [f for f in equations if f != self.equation and equations[f] == Name(self.equation)]

    def powers(self) -> dict[str, int] | None:
        """Return the exponent of each field; None if the term is no monomial of fields."""
        found: dict[str, int] = {}
        for factor in self.factors:
            match factor:
                case Name(id) if id in self.system.fields:
                    found[id] = found.get(id, 0) + 1
                case Power(Name(id), Number(n)) if (
                    id in self.system.fields and n > 0 and n % 1 == 0
                ):
                    found[id] = found.get(id, 0) + int(n)
                case _:
                    return None
        return found


def _constant(term: _Term) -> str | None:
    if term.expr != ONE:
        return None
    return f"constant {'source' if term.value > 0 else 'sink'} of {term.what}, {term.amount}"


def _periodic(term: _Term) -> str | None:
    match term.expr:
        case Call("sin" | "cos", inner):
            frequency, clock = split_coefficient(inner)
            if clock == Name("t"):
                length = f"{2 * math.pi / abs(frequency):.3g}"
                period = f"a period of {measured(length, term.system.units.get(TIME))}"
                return f"periodic drive of {term.what}, with {period}: {term.amount}"
    return None


def _drag(term: _Term) -> str | None:
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


def _restoring(term: _Term) -> str | None:
    for position in term.positions:
        pulls = term.value < 0
        if term.expr == Name(position):
            kind = "restoring force, as of a spring" if pulls else "force away from zero"
            return f"linear {kind}, on {term.what}: {term.amount}"
        if term.expr == Call("sin", Name(position)):
            kind = "stronger" if pulls else "weaker"
            return f"{kind} restoring force, as of gravity, on {term.what}: {term.amount}"
    return None


def _monomial(term: _Term) -> str | None:
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


def _others(term: _Term, powers: Mapping[str, int]) -> str:
    raised = {1: "", 2: " squared", 3: " cubed"}
    return " and ".join(
        meaning(term.system, field) + raised.get(n, f" to the {n}th power")
        for field, n in powers.items()
    )


def _where(powers: Mapping[str, int]) -> str:
    """`` where lam > 0``: on which side of zero a product of fields has the sign that is told."""
    odd = [field for field, n in powers.items() if n % 2]
    return f" where {'*'.join(odd)} > 0".replace("*", "·") if odd else ""


def _steep(term: _Term) -> str | None:
    match term.expr:
        case Power(Derivative(Name(id), _, 1), Number(2.0)) | Call("grad2", Name(id)):
            change = "growth" if term.value > 0 else "decrease"
            steep = "it" if id == term.equation else meaning(term.system, id)
            return f"{change} of {term.what} where {steep} is steep, {term.amount}"
    return None


def _spatial(term: _Term) -> str | None:
    """Words of what spreads, drifts or carries: one derivative of a field, times anything flat."""
    derived = [f for f in term.factors if is_spatial(f)]
    if len(derived) != 1 or (read := read_derivative(derived[0])) is None:
        return None
    rest = algebra.multiply(f for f in term.factors if f is not derived[0])
    operand, order, axis = read
    if operand == Power(Name(term.equation), Number(2.0)) and order == 1 and rest == ONE:
        # ∂(u²)/∂x = 2u ∂u/∂x.
        return _advection(term, Name(term.equation), axis, 2.0)
    if not isinstance(operand, Name) or operand.id not in term.system.fields:
        return None
    if operand.id != term.equation:
        kind = {1: "the gradient", 2: "the diffusion"}.get(order)
        of = f"of {meaning(term.system, operand.id)}"
        return kind and f"coupling of {term.what} to {kind} {of}, {term.amount}"
    return _advection(term, rest, axis, 1.0) if order == 1 else _smoothing(term, rest, order, axis)


def _advection(term: _Term, carrier: Expr, axis: str, factor: float) -> str:
    size = term.size(-factor)
    along = f" along {axis}" if len(term.system.axes) > 1 else ""
    if carrier == ONE:
        way = "forward" if term.value < 0 else "backward"
        return f"transport of {term.what}, {way} in {axis}, with velocity {size}"
    carried = f"with velocity ({size})·{_print(carrier)}"
    if algebra.names(carrier) & set(term.system.fields) == {term.equation}:
        return f"self-advection of {term.what}{along}, {carried}"
    return f"transport of {term.what}{along}, {carried}"


def _smoothing(term: _Term, rest: Expr, order: int, axis: str) -> str | None:
    size = term.size()
    along = f" along {axis}" if axis and len(term.system.axes) > 1 else ""
    if rest != ONE:
        if order != 2:
            return None
        return f"diffusion of {term.what}{along} with coefficient ({size})·{_print(rest)}"
    if order % 2:
        kind = f"dispersion of {term.what}{along} (waves of different length drift apart)"
        return f"{kind}, {term.amount}"
    smooths = (term.value > 0) == (order % 4 == 2)
    kinds = {
        2: ("diffusion", "anti-diffusion (sharpening)"),
        4: ("hyperviscosity (damping of the shortest waves)", "growth of the shortest waves"),
    }
    names = kinds.get(order, (f"smoothing of order {order}", f"sharpening of order {order}"))
    return f"{names[not smooths]} of {term.what}{along}, coefficient {size}"


def _print(expr: Expr) -> str:
    return pretty(algebra.to_text(expr)).replace("-", MINUS)
