"""Where the bundled systems lie: in the installed package, or beside it in a checkout."""

from __future__ import annotations

from importlib.resources import files
from pathlib import Path

from dashred.core.errors import InputError

PACKAGE = Path(str(files("dashred"))).resolve()
# The build puts conf/ into the package; in a checkout it stands beside it.
INSTALLED = (PACKAGE / "conf").is_dir()
CONF = PACKAGE / "conf" if INSTALLED else PACKAGE.parent / "conf"
BASE = CONF / "base.yaml"


def bundled() -> list[str]:
    """Names of the systems that come with dashred."""
    return sorted(path.stem for path in CONF.glob("*.yaml") if path != BASE)


def results_root() -> Path:
    """Return the folder that results go to by default.

    It is the checkout, or the current folder where dashred is installed.
    """
    return Path.cwd() if INSTALLED else PACKAGE.parent


def check_checkout(what: str) -> None:
    """Refuse what an installed package cannot do.

    Raises:
        InputError: this is not a checkout.
    """
    if INSTALLED:
        raise InputError(
            f"{what} in a checkout of dashred, and not in the installed package",
            where=str(PACKAGE),
            hint="clone the repository, and run the command there",
        )
