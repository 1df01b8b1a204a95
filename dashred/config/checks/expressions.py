"""Checks of the expressions in a configuration, before slow imports such as torch."""

from __future__ import annotations

from collections.abc import Callable

from dashred.config.checks.uncertain_parameters import check_uncertain_parameters
from dashred.config.schema.settings import Settings
from dashred.physics.declaration import Declaration


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
            declared.ready(declared.parse(text, key, equation=equation), equation, key)
