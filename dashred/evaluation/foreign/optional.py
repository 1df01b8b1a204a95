"""Import the packages of the extra ``evaluation``, which an installation may lack."""

from __future__ import annotations

from importlib import import_module
from importlib.util import find_spec
from typing import Any

from dashred.core.errors import InputError

# Packages whose module has another name.
PACKAGES = {"iterative_ensemble_smoother": "iterative-ensemble-smoother", "pde": "py-pde"}
HINT = 'pip install "dashred[evaluation]", in a checkout: pip install -e ".[evaluation]"'


def check_installed(*modules: str) -> None:
    """Check that modules can be imported, without importing them.

    Raises:
        InputError: one is not installed; the hint names the extra.
    """
    tops = [module.partition(".")[0] for module in modules]
    missing = [PACKAGES.get(top, top) for top in tops if find_spec(top) is None]
    if missing:
        verb = "is" if len(missing) == 1 else "are"
        raise InputError(
            f"{' and '.join(missing)} {verb} needed, and not installed",
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
