"""Library of candidate terms: the user's list, or a default built from the fields."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence, Set
from itertools import combinations_with_replacement

import torch
from torch import Tensor

from dashred.core.errors import InputError
from dashred.physics.backends.torch_backend import Program
from dashred.physics.boundaries.spatial_order import conditions_needed, has_stencils
from dashred.physics.expressions import algebra
from dashred.physics.grids.grid_value import Value
from dashred.physics.system import System, Term

ANGLE_UNITS = frozenset({"rad", "deg", "°"})
WAVES = frozenset({"sin", "cos"})


def build_library(system: System, listed: Mapping[str, Sequence[str]] | None) -> list[Term]:
    """Return the candidate terms of every equation, in normal form.

    Args:
        system: with the names that terms may contain.
        listed: expressions by equation (configuration key ``library``); None, or those of lets
            alone (:func:`dashred.physics.terms.let_terms.build_let_terms`), for the default.

    Raises:
        InputError: a term is invalid, two terms of one equation are proportional, or there is none.
    """
    named = {name: texts for name, texts in (listed or {}).items() if name in system.fields}
    chosen = named or {field: default_terms(system) for field in equations_with_candidates(system)}
    library: list[Term] = []
    for equation, texts in chosen.items():
        seen: dict[algebra.Expr, str] = {}
        for text in texts:
            key = f"library.{equation}"
            expr = algebra.split_coefficient(system.parse(text, key, equation=equation))[1]
            if not _has_enough_conditions(system, equation, expr):
                if named:
                    raise InputError(
                        f"{text!r} needs more conditions at the ends than {equation} has",
                        where=system.where(key),
                        hint="remove it: conditions for each side are for second derivatives, of a "
                        "field with derivatives in its equation",
                    )
                continue
            if expr in seen:
                raise InputError(
                    f"{seen[expr]!r} and {text!r} are the same term up to a factor",
                    where=system.where(key),
                    hint="remove one of them",
                )
            seen[expr] = text
            library.append(Term(equation, expr))
    if not library:
        raise InputError(
            "the library has no terms",
            where=system.where(f"library.{next(iter(chosen))}"),
            hint="list at least one, or remove library: the default terms are then used",
        )
    return library


def _has_enough_conditions(system: System, equation: str, term: algebra.Expr) -> bool:
    """Return whether the conditions at the ends suffice for an equation with one more term."""
    if not system.has_conditions:
        return True
    axes = tuple(system.config.axes)
    own = conditions_needed(system.resolved[equation], equation, axes)
    return conditions_needed(system.without_lets(term), equation, axes) <= (2 if own else 0)


def equations_with_candidates(system: System) -> list[str]:
    """Return the fields whose equations get candidate terms by default.

    An equation such as ``θ' = ω`` or ``q' = p/m`` only defines ω or p. A missing term there is
    equivalent to a redefinition of ω and a term in the equation of ω; sensors of θ cannot
    distinguish the two. Such equations get no candidates, unless all equations are of this kind.
    A negative factor makes a force: ``p' = -k q`` gets candidates. So does ``b' = k a`` if b has no
    effect on a: a is then something that becomes b, and no rate.
    """
    fields = system.fields
    # With snapshots there are no equations, so every field gets candidates.
    named = {field: system.resolved[field] for field in fields if field in system.resolved}
    others = {field: expr for field, expr in named.items() if not _is_definition(field, named)}
    return list(others) or list(fields)


def _is_definition(field: str, tendencies: Mapping[str, algebra.Expr]) -> bool:
    """Tell whether an equation only defines another field, up to a positive factor."""
    factor, rest = algebra.split_coefficient(tendencies[field])
    if not (factor > 0 and isinstance(rest, algebra.Name) and rest.id in tendencies):
        return False
    is_rate = factor == 1 or field in algebra.names(tendencies[rest.id])
    return is_rate and rest.id != field


def default_terms(system: System) -> list[str]:
    """Return distinct terms: powers, products and derivatives of fields, and inputs."""
    fields = list(system.fields)
    terms = list(_monomials(fields, 3 if len(fields) > 1 else 5))
    # An input may act with another strength, or on another equation.
    terms += list(system.inputs)
    if not system.axes:
        return terms + list(_pointwise(fields, angles(system)))
    terms += [f"{wave}({f})" for f in fields if f in angles(system) for wave in ("sin", "cos")]
    if len(system.axes) == 1:
        [axis] = system.axes
        on_radius = [f"lap({f})" for f in fields] if axis.radial else []
        spatial = on_radius + list(_derivatives_on_a_line(fields, axis.name))
    else:
        spatial = list(_derivatives_in_the_plane(fields, [axis.name for axis in system.axes]))
    if system.config.nodes is not None:
        spatial = [text for text in spatial if has_stencils(system.parse(text, "library"))]
    return terms + spatial


def _monomials(fields: Sequence[str], degree: int) -> Iterator[str]:
    yield "1"
    for total in range(1, degree + 1):
        for factors in combinations_with_replacement(fields, total):
            yield "*".join(factors)


def angles(system: System) -> set[str]:
    """Return the fields that are angles: a sine of a length or a concentration means nothing.

    A field is an angle if an equation contains its sine or cosine, or if its description or its
    unit says so.
    """
    waves = [e for expr in system.resolved.values() for e in calls(expr, WAVES)]
    found = set().union(*(algebra.names(e) for e in waves))
    stated = {f for f in system.fields if system.units.get(f) in ANGLE_UNITS}
    described = {f for f, text in system.config.fields.items() if "angle" in text.lower()}
    return (found & set(system.fields)) | stated | described


def calls(expr: algebra.Expr, functions: Set[str]) -> Iterator[algebra.Expr]:
    """Yield the calls of some functions within an expression."""
    if isinstance(expr, algebra.Call) and expr.function in functions:
        yield expr
    for child in algebra.children(expr):
        yield from calls(child, functions)


def _pointwise(fields: Sequence[str], angles: Set[str]) -> Iterator[str]:
    for f in fields:
        yield from (f"abs({f})*{f}", f"sign({f})")
        if f in angles:
            yield from (f"sin({f})", f"cos({f})", f"sin(2*{f})")
    if len(fields) == 1:
        f = fields[0]
        yield from (f"tanh({f})", f"exp(-{f}**2)", f"abs({f})", f"{f}**6", f"{f}**7")
        if f in angles:
            yield from (f"cos(2*{f})", f"{f}*sin({f})", f"{f}*cos({f})", f"sin(3*{f})")


def _derivatives_on_a_line(fields: Sequence[str], x: str) -> Iterator[str]:
    for f in fields:
        yield from (f"d({f}, {x})", f"d({f}, {x}, 2)", f"d({f}, {x}, 3)", f"d({f}, {x}, 4)")
        yield from (f"{g}*d({f}, {x})" for g in fields)
        yield f"d({f}, {x})**2"
    if len(fields) == 1:
        f = fields[0]
        yield from (f"{f}**2*d({f}, {x})", f"{f}**3*d({f}, {x})", f"{f}*d({f}, {x}, 2)")
        yield from (f"{f}**2*d({f}, {x}, 2)", f"{f}*d({f}, {x})**2", f"{f}*d({f}, {x}, 3)")
        yield f"d({f}, {x})*d({f}, {x}, 2)"


def _derivatives_in_the_plane(fields: Sequence[str], axes: Sequence[str]) -> Iterator[str]:
    for f in fields:
        yield from (f"d({f}, {x})" for x in axes)
        yield from (f"{g}*d({f}, {x})" for g in fields for x in axes)
        yield from (f"lap({f})", f"lap(lap({f}))", f"grad2({f})")
        yield from (f"{g}*lap({f})" for g in fields)
    if len(fields) == 1:
        f = fields[0]
        yield from (f"{f}**2*lap({f})", f"abs({f})*{f}", f"lap({f}**3)", f"inv_lap({f})")


def resolve(system: System, library: Sequence[Term]) -> tuple[Term, ...]:
    """Substitute lets and parameters in the terms, for :class:`Forcing`."""
    return tuple(
        Term(t.equation, system.ready(t.expression, t.equation, f"library.{t.equation}"))
        for t in library
    )


def evaluate_terms(
    system: System, library: Sequence[Term], states: Tensor, t: float | Tensor
) -> Tensor:
    """Return the columns θ_j, ``(term, batch, *grid)``.

    Args:
        system: with the operators and inputs.
        library: the terms.
        states: ``(batch, field, *grid)``.
        t: one time for all states, or the time of each, ``(batch,)``.
    """
    program = Program([term.expression for term in resolve(system, library)])
    operators = system.operators
    moment = t.reshape(-1, *(1 for _ in system.grid.shape)).numpy() if isinstance(t, Tensor) else t
    values: dict[str, Value] = system.values(states, moment)
    shape = (len(states), *system.grid.shape)
    found = (operators.on_grid(value) for value in program(values, operators))
    return torch.stack([torch.as_tensor(f, dtype=torch.float64).expand(shape) for f in found])
