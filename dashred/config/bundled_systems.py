"""Location of the bundled systems: in the installed package, or beside it in a checkout."""

from __future__ import annotations

from importlib.resources import files
from pathlib import Path

from dashred.core.errors import InputError, nearest

PACKAGE = Path(str(files("dashred"))).resolve()
# The build copies conf/ into the package; in a checkout it is beside the package.
IS_INSTALLED = (PACKAGE / "conf").is_dir()
CONF = PACKAGE / "conf" if IS_INSTALLED else PACKAGE.parent / "conf"
BASE = CONF / "base.yaml"


def bundled_names() -> list[str]:
    """Return the names of the bundled systems."""
    return sorted(path.stem for path in CONF.glob("*.yaml") if path != BASE)


def read_bundled_name(text: str) -> str:
    """Read the name of a bundled system.

    Raises:
        ValueError: there is no such system.
    """
    if text not in bundled_names():
        raise ValueError(f"there is no bundled system {text!r}: {nearest(text, bundled_names())}")
    return text


def results_root() -> Path:
    """Return the default folder of results.

    It is the root of the checkout, or the current folder if dashred is installed as a package.
    """
    return Path.cwd() if IS_INSTALLED else PACKAGE.parent


def check_checkout(what: str) -> None:
    """Check that dashred runs from a checkout.

    Args:
        what: what needs a checkout, as the start of the message, such as ``the proof is run``.

    Raises:
        InputError: dashred is an installed package.
    """
    if IS_INSTALLED:
        raise InputError(
            f"{what} in a checkout of dashred, and not in the installed package",
            where=str(PACKAGE),
            hint="clone the repository, and run the command there",
        )
