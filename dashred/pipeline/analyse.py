"""Analysis of one recording, from the command line or from a configuration."""

from __future__ import annotations

from pathlib import Path

from dashred.config import Config, load_config
from dashred.config.checks.placeholders import refuse_unfinished_lines
from dashred.core.command_line.entry import fast_imports
from dashred.core.errors import DONE, InputError
from dashred.core.mlflow.store_check import check_store


def main(argv: list[str]) -> int:
    """Analyse the recording that the command line names."""
    config = load_config(argv, entry="train")
    refuse_unfinished_lines(config)
    check_store(config.tracking.root, config.tracking.artifacts)
    analyse(config)
    return DONE


def analyse(config: Config) -> Path:
    """Analyse one recording and return the output folder.

    Raises:
        InputError: the input is wrong; the output folder may have been created, but is empty.
    """
    if config.recording.path is None:
        raise InputError(
            "there is nothing to analyse",
            where=config.where("recording"),
            hint="give recording.path=FILE, or recording.twin=NAME for a twin experiment",
        )
    # Imported here because torch takes seconds to import, and input errors should appear at once.
    if config.system.snapshots is not None:
        with fast_imports():
            from dashred.pipeline.snapshots.black_box import analyse_snapshots
        return analyse_snapshots(config)
    with fast_imports():
        from dashred.pipeline.equations import analyse_equations

    return analyse_equations(config)
