"""The folder of the findings."""

from __future__ import annotations

from pathlib import Path

from dashred.errors import InputError

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
