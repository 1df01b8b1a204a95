"""The output folder of a run."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path
from tempfile import TemporaryFile

from dashred.config import Config
from dashred.core.errors import InputError
from dashred.core.files.atomic import clear_partial
from dashred.core.mlflow.store_address import is_server
from dashred.pipeline.run.run_manifest import POINTER
from dashred.reporting.figures.figure_names import is_report_figure

FREEZE = "freeze.json"
# Files that an analysis writes besides its figures. All are deleted before a run, because files of
# an earlier run would look like its results.
RESULTS = (
    FREEZE,
    "findings.json",
    "estimates.nc",
    "forecast.nc",
    "observer_spread.nc",
    "corrected.yaml",
    "corrected.fmu",
    "estimator.nc",
    "report.html",
    "run.json",
    "summary.txt",
)
SCORE = "score.json"
HINT = "choose another folder: output=DIR"


def named_output(config: Config) -> Path | None:
    """Create the folder of `output=DIR`; return None if the user has not named one.

    Raises:
        InputError: the folder cannot be created or written to, or a run would delete files in it
            that dashred has not written.
    """
    if not config.output:
        return None
    folder = make_output(config.output)
    check_ours(folder, _inputs(config), config.output)
    return folder


def check_output(config: Config) -> None:
    """Check that the output folders of a run can be created and written to; create nothing.

    Raises:
        InputError: as :func:`named_output`, or the folder of `tracking.root` is not usable.
    """
    if not is_server(config.tracking.root):
        _check_possible(config.tracking.root, "choose another folder: tracking.root=DIR")
    if config.output:
        _check_possible(config.output, HINT)
        check_ours(Path(config.output), _inputs(config), config.output)


def _check_possible(path: str, hint: str) -> None:
    folder = Path(path).absolute()
    existing = next(each for each in (folder, *folder.parents) if os.path.lexists(each))
    if not existing.is_dir():
        what = f"this folder cannot be created: {existing} is not a folder"
        raise InputError(what, where=path, hint=hint)
    _check_writable(existing, path, hint)


def _inputs(config: Config) -> list[Path]:
    """Return the files that a run reads."""
    named = (config.source, config.recording.path, config.recording.sensors)
    return [Path(path) for path in named if isinstance(path, str | Path)]


def check_ours(folder: Path, inputs: Sequence[Path], where: str) -> None:
    """Refuse a folder in which a run would delete files that no run has written.

    A finished run leaves its freeze file; an interrupted run leaves a pointer to itself.

    Raises:
        InputError: there are such files, or the input of the run is among its results.
    """
    existing = [folder / name for name in (*RESULTS, SCORE) if (folder / name).exists()]
    for path in existing:
        if any(path.samefile(given) for given in inputs if given.exists()):
            what = f"a run would overwrite its own input {path.name}"
            raise InputError(what, where=where, hint=HINT)
    if existing and not any((folder / mark).is_file() for mark in (FREEZE, POINTER)):
        what = f"a run would replace {existing[0].name}, which was not written by dashred"
        raise InputError(what, where=where, hint=HINT)


def make_output(path: str) -> Path:
    """Create the folder that the user named and check that it is writable.

    Raises:
        InputError: the folder cannot be created or written to, or is a file.
    """
    folder = Path(path)
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        what = f"this folder cannot be created: {error.strerror}"
        raise InputError(what, where=path, hint=HINT) from None
    _check_writable(folder, path)
    return folder


def _check_writable(folder: Path, path: str, hint: str = HINT) -> None:
    try:
        # Permissions are not enough: the disk may be mounted read-only.
        with TemporaryFile(dir=folder):
            return
    except OSError as error:
        what = f"this folder cannot be written to: {error.strerror}"
        raise InputError(what, where=path, hint=hint) from None


def clear_output(folder: Path) -> None:
    """Delete the results of an earlier run and the partial files of a killed one."""
    clear_partial(folder)
    _clear_figures(folder)
    for name in (*RESULTS, SCORE):
        (folder / name).unlink(missing_ok=True)


def _clear_figures(folder: Path) -> None:
    """Delete the figures of an earlier run.

    A run freezes its findings before it draws. Without a freeze file the figures are not ours.
    """
    if (folder / FREEZE).is_file():
        for path in sorted(folder.iterdir()):
            if is_report_figure(path):
                path.unlink()


def results_in(folder: Path) -> list[Path]:
    """Return the result files of an analysis, without its figures."""
    return [folder / name for name in RESULTS if (folder / name).is_file()]
