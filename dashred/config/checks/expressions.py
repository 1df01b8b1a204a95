"""Checks of the expressions in a configuration, before slow imports such as torch."""

from __future__ import annotations

from collections.abc import Callable

from dashred.config.checks.uncertain_parameters import check_uncertain_parameters
from dashred.config.schema.settings import Settings
from dashred.core.errors import InputError
from dashred.physics.declaration import Declaration
from dashred.physics.expressions.algebra import names


def check_expressions(settings: Settings, where: Callable[[str], str]) -> None:
    """Check equations, lets, the energy, uncertain parameters, start values and candidate terms.

    Raises:
        InputError: an expression is invalid; see :class:`dashred.physics.declaration.Declaration`
            and :func:`check_uncertain_parameters`.
    """
    declared = Declaration(settings.system, where)
    check_uncertain_parameters(declared)
    for field, text in settings.system.start.items():
        key = f"system.start.{field}"
        declared.ready(declared.parse(str(text), key), field, key)
    for equation, texts in (settings.library or {}).items():
        key = f"library.{equation}"
        for text in texts:
            if equation in declared.lets:
                _check_let_term(declared, equation, text)
            else:
                declared.ready(declared.parse(text, key, equation=equation), equation, key)


def _check_let_term(declared: Declaration, let: str, text: str) -> None:
    key = f"library.{let}"
    theta = declared.parse(text, key)
    declared.resolve(theta, key)
    order = list(declared.lets)
    if later := names(theta) & set(order[order.index(let) + 1 :]):
        raise InputError(
            f"the term {text!r} of let {let!r} reads {min(later)!r}, which is defined after it",
            where=declared.where(key),
        )
    if not any(let in names(declared.without_lets(e, let)) for e in declared.equations.values()):
        raise InputError(
            f"no equation reads let {let!r}, so a change of it has no effect",
            where=declared.where(key),
        )
