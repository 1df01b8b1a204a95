"""Store of sealed truths in a private folder of the recorder, by MLflow run.

A seal survives an interruption, so that a resumed experiment can be scored. The folder is separate
from the output of the analysis and from the artifacts of MLflow.
"""

from __future__ import annotations

import shutil
from pathlib import Path

from dashred.core.files.state_dir import state_folder

SEALED = "sealed.nc"


def store_seal(run_id: str, sealed: Path) -> None:
    """Move the seal of a run into the store."""
    shutil.move(sealed, _folder(run_id) / SEALED)


def find_seal(run_id: str) -> Path | None:
    """Return the path of the seal of a run; None if it has none, or it was opened."""
    path = state_folder("recorder") / run_id / SEALED
    return path if path.is_file() else None


def delete_seal(run_id: str) -> None:
    """Delete the seal of a run."""
    shutil.rmtree(_folder(run_id))


def _folder(run_id: str) -> Path:
    return state_folder("recorder", run_id)
