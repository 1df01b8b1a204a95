"""The folder of the findings."""

from __future__ import annotations

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


def named_output(config: Config) -> Path | None:
    """Make the folder of `output=DIR`; None where the user has named none.

    Raises:
        InputError: it cannot be made, or holds MLflow's store, which keeps a copy of it.
    """
    if not config.output:
        return None
    folder, store = Path(config.output), Path(config.tracking.root).expanduser()
    if not is_server(config.tracking.root) and store.resolve().is_relative_to(folder.resolve()):
        what = f"MLflow's store, {store}, lies in this folder, and would keep a copy of itself"
        hint = "name a folder of its own: output=DIR or tracking.root=DIR"
        raise InputError(what, where=config.output, hint=hint)
    return make_output(config.output)


def make_output(path: str) -> Path:
    """Make the folder that the user named, and make sure that it can be written to.

    Raises:
        InputError: it cannot be made or written to, or is a file.
    """
    folder, hint = Path(path), "choose another: output=DIR"
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        what = f"this folder cannot be made: {error.strerror}"
        raise InputError(what, where=path, hint=hint) from None
    try:
        # Rights alone do not tell: a disk may be mounted for reading only.
        with TemporaryFile(dir=folder):
            return folder
    except OSError as error:
        what = f"this folder cannot be written to: {error.strerror}"
        raise InputError(what, where=path, hint=hint) from None


def clear_output(folder: Path) -> None:
    """Take away the results of an earlier run, and what a killed one had not finished."""
    clear_partial(folder)
    for name in OF_ONE_RUN:
        (folder / name).unlink(missing_ok=True)
