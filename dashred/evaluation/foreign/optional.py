"""Import the packages of the extra ``evaluation``, which an installation may lack."""

from __future__ import annotations

from importlib import import_module
from importlib.util import find_spec
from typing import Any

from dashred.core.errors import InputError

HINT = 'pip install "dashred[evaluation]", in a checkout: pip install -e ".[evaluation]"'


def check_installed(*modules: str) -> None:
    """Check that modules can be imported, without importing them.

    Raises:
        InputError: one is not installed; the hint names the extra.
    """
    missing = [module for module in modules if find_spec(module.partition(".")[0]) is None]
    if missing:
        verb = "is" if len(missing) == 1 else "are"
        raise InputError(
            f"{' and '.join(missing)} {verb} needed to make these cases, and not installed",
            where="dashred evaluate foreign",
            hint=HINT,
        )


def import_optional(module: str) -> Any:
    """Import a module of the extra.

    Raises:
        InputError: it is not installed; the hint names the extra.
    """
    check_installed(module)
    return import_module(module)
