"""The folder of the findings."""

from __future__ import annotations

from pathlib import Path

from dashred.config import Config
from dashred.errors import InputError
from dashred.mlflow_server import is_server

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
    """Make the folder that the user named.

    Raises:
        InputError: it cannot be made, or is a file.
    """
    folder = Path(path)
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        what, hint = f"this folder cannot be made: {error.strerror}", "choose another: output=DIR"
        raise InputError(what, where=path, hint=hint) from None
    return folder


def clear_output(folder: Path) -> None:
    """Take away the results of an earlier run."""
    for name in OF_ONE_RUN:
        (folder / name).unlink(missing_ok=True)
