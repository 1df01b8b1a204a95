"""Describe terms with spatial derivatives: diffusion, transport, advection and other effects."""

from __future__ import annotations

from dashred.physics.expressions import algebra
from dashred.physics.expressions.algebra import ONE, Call, Derivative, Expr, Name, Number, Power
from dashred.reporting.wording.sized_term import Description, SizedTerm, format_expression, meaning
from dashred.reporting.wording.spatial_shape import is_spatial, read_derivative


def describe_squared_gradient(term: SizedTerm) -> Description | None:
    """Describe a squared gradient ``(∂u/∂x)²`` or ``|∇u|²``; return None for other terms."""
    match term.expr:
        case Power(Derivative(Name(id), _, 1), Number(2.0)) | Call("grad2", Name(id)):
            change = "growth" if term.value > 0 else "decrease"
            steep = "it" if id == term.equation else meaning(term.system, id)
            return Description(
                f"{change} of {term.field_meaning} where {steep} is steep", term.text
            )
    return None


def describe_spatial(term: SizedTerm) -> Description | None:
    """Describe a derivative times factors without derivatives; return None for other terms."""
    derivatives = [f for f in term.factors if is_spatial(f)]
    if len(derivatives) != 1 or (read := read_derivative(derivatives[0])) is None:
        return None
    rest = algebra.multiply(f for f in term.factors if f is not derivatives[0])
    operand, order, axis = read
    if operand == Power(Name(term.equation), Number(2.0)) and order == 1 and rest == ONE:
        # ∂(u²)/∂x = 2u ∂u/∂x.
        return _advection(term, Name(term.equation), axis, 2.0)
    if not isinstance(operand, Name) or operand.id not in term.system.fields:
        return None
    if operand.id != term.equation:
        kind = {1: "the gradient", 2: "the diffusion"}.get(order)
        if kind is None:
            return None
        effect = f"coupling of {term.field_meaning} to {kind} of {meaning(term.system, operand.id)}"
        return Description(effect, term.text)
    return _advection(term, rest, axis, 1.0) if order == 1 else _smoothing(term, rest, order, axis)


def _advection(term: SizedTerm, carrier: Expr, axis: str, factor: float) -> Description:
    size = term.size(-factor)
    along = f" along {axis}" if len(term.system.axes) > 1 else ""
    if carrier == ONE:
        direction = "forward" if term.value < 0 else "backward"
        effect = f"{direction} transport of {term.field_meaning} in {axis}"
        return Description(effect, size, ", with velocity ")
    kind = "transport"
    if algebra.names(carrier) & set(term.system.fields) == {term.equation}:
        kind = "self-advection"
    velocity = f"({size})·{format_expression(carrier)}"
    return Description(f"{kind} of {term.field_meaning}{along}", velocity, ", with velocity ")


def _smoothing(term: SizedTerm, rest: Expr, order: int, axis: str) -> Description | None:
    size = term.size()
    along = f" along {axis}" if axis and len(term.system.axes) > 1 else ""
    if rest != ONE:
        if order != 2:
            return None
        coefficient = f"({size})·{format_expression(rest)}"
        return Description(
            f"diffusion of {term.field_meaning}{along}", coefficient, " with coefficient "
        )
    if order % 2:
        effect = (
            f"dispersion of {term.field_meaning}{along} (the wave speed depends on the wavelength)"
        )
        return Description(effect, term.text)
    smooths = (term.value > 0) == (order % 4 == 2)
    kinds = {
        2: ("diffusion", "anti-diffusion (sharpening)"),
        4: ("hyperviscosity (damping of the shortest waves)", "growth of the shortest waves"),
    }
    names = kinds.get(order, (f"smoothing of order {order}", f"sharpening of order {order}"))
    return Description(
        f"{names[not smooths]} of {term.field_meaning}{along}", size, ", coefficient "
    )
