"""Check that the workers of a cluster run the code of this process."""

from __future__ import annotations

import hashlib
import platform
from collections.abc import Callable
from importlib.metadata import version
from pathlib import Path
from typing import Any, Protocol

from dashred.core.cluster.word import WHERE
from dashred.core.errors import InputError

# Their versions decide the bits of a result.
PACKAGES = ("numpy", "scipy", "torch", "numba")


class Workers(Protocol):
    """What runs a function on all workers: a client of Dask."""

    def run(self, function: Callable[[], Any]) -> dict[str, Any]:
        """Return what the function returns, by the address of the worker."""


def identity() -> dict[str, str]:
    """Return what decides the results of this process: the code and the versions under it."""
    root = Path(__file__).resolve().parents[2]
    code = hashlib.sha256()
    for path in sorted(root.rglob("*.py")):
        code.update(path.relative_to(root).as_posix().encode())
        code.update(path.read_bytes())
    packages = {name: version(name) for name in PACKAGES}
    python = ".".join(platform.python_version_tuple()[:2])
    return {"dashred": code.hexdigest()[:12], "Python": python, **packages}


def check_workers(client: Workers) -> None:
    """Compare all workers with this process.

    Raises:
        InputError: a worker lacks the package, or has other code or other versions.
    """

    # Defined here so that it is sent by value: a worker without the package can run it.
    def ask() -> dict[str, str] | str:
        try:
            from dashred.core.cluster.workers import identity
        except ImportError as error:
            return str(error)
        return identity()

    own = identity()
    for address, found in sorted(client.run(ask).items()):
        if isinstance(found, str):
            raise InputError(
                f"the worker {address} does not have the package: {found}",
                where=WHERE,
                hint="install dashred where the worker runs, in the version of this machine",
            )
        different = [name for name in own if found.get(name) != own[name]]
        if different:
            listed = ", ".join(f"{name} {found.get(name)}, here {own[name]}" for name in different)
            raise InputError(
                f"the worker {address} has other versions: {listed}",
                where=WHERE,
                hint="install the same versions on all machines: results depend on them",
            )
