"""The folder of the findings."""

from __future__ import annotations

import os
from pathlib import Path
from tempfile import TemporaryFile

from dashred.config import Config
from dashred.errors import InputError
from dashred.mlflow_server import is_server
from dashred.whole_files import clear_partial

# What one run leaves and the next may not write again: it would pass for part of that one.
OF_ONE_RUN = (
    "freeze.json",
    "findings.json",
    "estimates.nc",
    "forecast.nc",
    "corrected.yaml",
    "report.html",
    "score.json",
)
ANOTHER = "choose another: output=DIR"


def named_output(config: Config) -> Path | None:
    """Make the folder of `output=DIR`; None where the user has named none.

    Raises:
        InputError: it cannot be made, or holds MLflow's store, which keeps a copy of it.
    """
    if not config.output:
        return None
    _check_store(config.output, config.tracking.root)
    return make_output(config.output)


def check_output(config: Config) -> None:
    """Make sure that the folder of `output=DIR` could be made and written to; leave nothing.

    Raises:
        InputError: as :func:`named_output`.
    """
    if not config.output:
        return
    _check_store(config.output, config.tracking.root)
    folder = Path(config.output).absolute()
    there = next(path for path in (folder, *folder.parents) if os.path.lexists(path))
    if not there.is_dir():
        what = f"this folder cannot be made: {there} is no folder"
        raise InputError(what, where=config.output, hint=ANOTHER)
    _check_writable(there, config.output)


def _check_store(output: str, root: str) -> None:
    folder, store = Path(output), Path(root).expanduser()
    if not is_server(root) and store.resolve().is_relative_to(folder.resolve()):
        what = f"MLflow's store, {store}, lies in this folder, and would keep a copy of itself"
        hint = "name a folder of its own: output=DIR or tracking.root=DIR"
        raise InputError(what, where=output, hint=hint)


def make_output(path: str) -> Path:
    """Make the folder that the user named, and make sure that it can be written to.

    Raises:
        InputError: it cannot be made or written to, or is a file.
    """
    folder = Path(path)
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        what = f"this folder cannot be made: {error.strerror}"
        raise InputError(what, where=path, hint=ANOTHER) from None
    _check_writable(folder, path)
    return folder


def _check_writable(folder: Path, path: str) -> None:
    try:
        # Rights alone do not tell: a disk may be mounted for reading only.
        with TemporaryFile(dir=folder):
            return
    except OSError as error:
        what = f"this folder cannot be written to: {error.strerror}"
        raise InputError(what, where=path, hint=ANOTHER) from None


def clear_output(folder: Path) -> None:
    """Take away the results of an earlier run, and what a killed one had not finished."""
    clear_partial(folder)
    for name in OF_ONE_RUN:
        (folder / name).unlink(missing_ok=True)
