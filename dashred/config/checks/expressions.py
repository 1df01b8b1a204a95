"""Expressions of a configuration: refused before anything that takes seconds to load is loaded."""

from __future__ import annotations

from collections.abc import Callable

from dashred.config.schema.settings import Settings
from dashred.physics.declaration import Declaration


def check_expressions(settings: Settings, where: Callable[[str], str]) -> None:
    """Refuse equations, lets, an energy, starts and candidate terms that are not in the language.

    Raises:
        InputError: see :class:`dashred.physics.declaration.Declaration`.
    """
    declared = Declaration(settings.system, where)
    for field, text in settings.system.start.items():
        key = f"system.start.{field}"
        declared.ready(declared.parse(str(text), key), field, key)
    for equation, texts in (settings.library or {}).items():
        key = f"library.{equation}"
        for text in texts:
            declared.ready(declared.parse(text, key, equation=equation), equation, key)
