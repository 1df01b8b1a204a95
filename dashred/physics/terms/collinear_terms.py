"""Terms of a library that a simulation cannot tell apart."""

from __future__ import annotations

from collections.abc import Collection, Sequence

import torch
from torch import Tensor

from dashred.core.errors import InputError
from dashred.physics.expressions.algebra import Expr, names
from dashred.physics.system import System, Term
from dashred.physics.terms.column_blocks import in_blocks
from dashred.physics.terms.library import calls, evaluate_terms

# Functions that differ from a power only where their argument changes its sign.
KINKS = frozenset({"abs", "sign"})
# Columns with a larger cosine of their angle, up to this, are proportional.
COLLINEARITY_TOLERANCE = 1e-9


def uninformative_terms(
    system: System,
    library: Sequence[Term],
    states: Tensor,
    t: float | Tensor,
    moved: Tensor | None = None,
) -> dict[Term, str | Term]:
    """Return the terms that data like the simulation cannot identify, each with the reason.

    The column of such a term on the states ``(batch, field, *grid)`` vanishes, is not finite, or
    is proportional to the column of an earlier term of the equation, which is then the reason.
    Two fields may be equal in a simulation that lacks what makes them differ, and a field may be
    constant in one that lacks what moves it. Terms of several fields or of constant fields, without
    kinks, count as proportional only if they are so on other states, too.

    Args:
        system: the simulator.
        library: the terms.
        states: ``(batch, field, *grid)``.
        t: one time for all states, or the time of each, ``(batch,)``; terms with inputs need the
            latter, because an input is constant at a single time.
        moved: other states, each field moved by itself, same shape; None without any.
    """
    is_finite = torch.ones(len(library), dtype=torch.bool)
    vanishes = is_finite.clone()
    products, scale = torch.zeros((len(library), len(library))).double(), None
    for part, times in in_blocks(states, t, len(library)):
        columns = evaluate_terms(system, library, part, times).flatten(1)
        is_finite &= torch.isfinite(columns).all(dim=1)
        vanishes &= ~columns.any(dim=1)
        columns[~is_finite] = 0.0
        if scale is None:
            size = columns.norm(dim=1, keepdim=True)
            scale = torch.where(size > 0, size, 1.0)
        unit = columns / scale
        products += unit @ unit.T
    norms = products.diagonal().sqrt().clamp(min=1e-300)
    alike = (products / norms / norms[:, None]).abs() > 1 - COLLINEARITY_TOLERANCE
    alike &= is_finite & is_finite[:, None]
    why: dict[Term, str | Term] = {}
    for j, term in enumerate(library):
        if not is_finite[j]:
            why[term] = "is not finite"
        elif vanishes[j]:
            why[term] = "vanishes"
    for later, term in enumerate(library):
        for earlier, other in enumerate(library[:later]):
            if alike[later, earlier] and other.equation == term.equation and other not in why:
                why[term] = other
                break
    if moved is not None:
        constant = constant_fields(system, states)
        for term, reason in list(why.items()):
            if isinstance(reason, str):
                continue
            mine, theirs = (system.resolve(each.expression, "library") for each in (term, reason))
            if not may_differ(system, mine, theirs, constant):
                continue
            if term not in uninformative_terms(system, (reason, term), moved, t):
                del why[term]
    return why


def may_differ(
    system: System, one: Expr, other: Expr, constant: Collection[str] = frozenset()
) -> bool:
    """Return whether expressions that are proportional on some states may differ on others.

    They may if both have fields, together at least two, which may be equal on these states; or if
    nothing in them varies on these states. They must not have kinks, which other states would
    cross.

    Args:
        system: the simulator.
        one: a resolved expression.
        other: another one.
        constant: fields that have one value on these states.
    """
    if any(any(calls(expr, KINKS)) for expr in (one, other)):
        return False
    read = names(one), names(other)
    mine, theirs = (each & set(system.fields) for each in read)
    is_still = read[0] | read[1] <= set(constant)
    return is_still or bool(mine and theirs and len(mine | theirs) > 1)


def constant_fields(system: System, states: Tensor) -> frozenset[str]:
    """Return the fields that have one value on states ``(batch, field, *grid)``."""
    flat = states.transpose(0, 1).flatten(1)
    is_constant = (flat == flat[:, :1]).all(dim=1).tolist()
    return frozenset(name for name, one in zip(system.fields, is_constant, strict=True) if one)


def check_collinear(
    system: System,
    library: Sequence[Term],
    states: Tensor,
    t: float | Tensor,
    moved: Tensor | None = None,
) -> None:
    """Check that no columns are proportional on the simulation: data could not distinguish them.

    Raises:
        InputError: two columns are proportional, or one is zero or not finite.
    """
    for term, why in uninformative_terms(system, library, states, t, moved).items():
        where = system.where(f"library.{term.equation}")
        if isinstance(why, str):
            fault, hint = f"the term {str(term)!r} {why} on the simulation", "remove it"
        else:
            fault = f"the terms {str(why)!r} and {str(term)!r} are proportional on this system"
            hint = "remove one of them"
        raise InputError(fault, where=where, hint=hint)
