"""Where a closed seal waits for the findings: a folder of the recorder's own, by MLflow run.

It outlives an experiment that is cut short, so that one that goes on can be scored. It lies with
none of what the analysis writes or MLflow shows.
"""

from __future__ import annotations

import shutil
from pathlib import Path

from dashred.core.files.state_dir import state_folder

SEALED = "sealed.nc"


def keep_seal(run_id: str, sealed: Path) -> None:
    """Take the seal over from where it was recorded."""
    shutil.move(sealed, _folder(run_id) / SEALED)


def kept_seal(run_id: str) -> Path | None:
    """Return the seal of a run; None where it has none, or it was opened and handed out."""
    path = state_folder("recorder") / run_id / SEALED
    return path if path.is_file() else None


def drop_seal(run_id: str) -> None:
    """Forget the seal of a run."""
    shutil.rmtree(_folder(run_id))


def _folder(run_id: str) -> Path:
    return state_folder("recorder", run_id)
