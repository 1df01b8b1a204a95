"""The folder of the findings."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path
from tempfile import TemporaryFile

from dashred.config import Config
from dashred.core.errors import InputError
from dashred.core.files.atomic import clear_partial
from dashred.core.files.user_path import is_server
from dashred.pipeline.run.run_manifest import POINTER
from dashred.reporting.figures.figure_names import drawn_by_us

FREEZE = "freeze.json"
# What an analysis leaves beside its figures. The next may not write all of it again, and what is
# left of an earlier one would pass for part of it.
RESULTS = (
    FREEZE,
    "findings.json",
    "estimates.nc",
    "forecast.nc",
    "corrected.yaml",
    "report.html",
    "run.json",
    "summary.txt",
)
SCORE = "score.json"
ANOTHER = "choose another: output=DIR"


def named_output(config: Config) -> Path | None:
    """Make the folder of `output=DIR`; None where the user has named none.

    Raises:
        InputError: it cannot be made or written to, or holds what a run would take away and dashred
            has not written.
    """
    if not config.output:
        return None
    folder = make_output(config.output)
    check_ours(folder, _inputs(config), config.output)
    return folder


def check_output(config: Config) -> None:
    """Make sure that what a run writes to could be made and written to; leave nothing.

    Raises:
        InputError: as :func:`named_output`, or as the store of `tracking.root` would be refused.
    """
    if not is_server(config.tracking.root):
        _check_possible(config.tracking.root, "choose another: tracking.root=DIR")
    if config.output:
        _check_possible(config.output, ANOTHER)
        check_ours(Path(config.output), _inputs(config), config.output)


def _check_possible(path: str, hint: str) -> None:
    folder = Path(path).absolute()
    there = next(each for each in (folder, *folder.parents) if os.path.lexists(each))
    if not there.is_dir():
        what = f"this folder cannot be made: {there} is no folder"
        raise InputError(what, where=path, hint=hint)
    _check_writable(there, path, hint)


def _inputs(config: Config) -> list[Path]:
    """Return the files that a run reads."""
    named = (config.source, config.recording.path, config.recording.sensors)
    return [Path(path) for path in named if isinstance(path, str | Path)]


def check_ours(folder: Path, inputs: Sequence[Path], where: str) -> None:
    """Refuse a folder of which a run would take away files that no run has left there.

    Every run leaves what it has frozen; one that was cut short, the name of its run.

    Raises:
        InputError: there are such files, or the run's own input is among its results.
    """
    taken = [folder / name for name in (*RESULTS, SCORE) if (folder / name).exists()]
    for path in taken:
        if any(path.samefile(given) for given in inputs if given.exists()):
            what = f"a run would write its {path.name} over the one that it is to read"
            raise InputError(what, where=where, hint=ANOTHER)
    if taken and not any((folder / mark).is_file() for mark in (FREEZE, POINTER)):
        what = f"{taken[0].name} is there, not from a run of dashred, and a run would replace it"
        raise InputError(what, where=where, hint=ANOTHER)


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


def _check_writable(folder: Path, path: str, hint: str = ANOTHER) -> None:
    try:
        # Rights alone do not tell: a disk may be mounted for reading only.
        with TemporaryFile(dir=folder):
            return
    except OSError as error:
        what = f"this folder cannot be written to: {error.strerror}"
        raise InputError(what, where=path, hint=hint) from None


def clear_output(folder: Path) -> None:
    """Take away the results of an earlier run, and what a killed one had not finished."""
    clear_partial(folder)
    _clear_figures(folder)
    for name in (*RESULTS, SCORE):
        (folder / name).unlink(missing_ok=True)


def _clear_figures(folder: Path) -> None:
    """Take away the figures of an earlier run, which has frozen its findings before it drew.

    Where none has, one that was brought there is somebody else's.
    """
    if (folder / FREEZE).is_file():
        for path in sorted(folder.iterdir()):
            if drawn_by_us(path):
                path.unlink()


def results_in(folder: Path) -> list[Path]:
    """Return what an analysis has left in a folder that it cleared, its figures left out."""
    return [folder / name for name in RESULTS if (folder / name).is_file()]
