"""What a term with derivatives in space does: spreads, drifts, carries, sharpens."""

from __future__ import annotations

from dashred.inference.wording.sized_term import SizedTerm, meaning, printed
from dashred.inference.wording.spatial_shape import is_spatial, read_derivative
from dashred.physics.expressions import algebra
from dashred.physics.expressions.algebra import ONE, Call, Derivative, Expr, Name, Number, Power


def steep_words(term: SizedTerm) -> str | None:
    """Words of what acts where a field is steep: ``(∂u/∂x)²``, ``|∇u|²``; None of other terms."""
    match term.expr:
        case Power(Derivative(Name(id), _, 1), Number(2.0)) | Call("grad2", Name(id)):
            change = "growth" if term.value > 0 else "decrease"
            steep = "it" if id == term.equation else meaning(term.system, id)
            return f"{change} of {term.what} where {steep} is steep, {term.amount}"
    return None


def spatial_words(term: SizedTerm) -> str | None:
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


def _advection(term: SizedTerm, carrier: Expr, axis: str, factor: float) -> str:
    size = term.size(-factor)
    along = f" along {axis}" if len(term.system.axes) > 1 else ""
    if carrier == ONE:
        way = "forward" if term.value < 0 else "backward"
        return f"transport of {term.what}, {way} in {axis}, with velocity {size}"
    carried = f"with velocity ({size})·{printed(carrier)}"
    if algebra.names(carrier) & set(term.system.fields) == {term.equation}:
        return f"self-advection of {term.what}{along}, {carried}"
    return f"transport of {term.what}{along}, {carried}"


def _smoothing(term: SizedTerm, rest: Expr, order: int, axis: str) -> str | None:
    size = term.size()
    along = f" along {axis}" if axis and len(term.system.axes) > 1 else ""
    if rest != ONE:
        if order != 2:
            return None
        return f"diffusion of {term.what}{along} with coefficient ({size})·{printed(rest)}"
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
