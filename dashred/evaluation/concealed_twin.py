"""Record the twin of a case and keep its truth in memory."""

from __future__ import annotations

from pathlib import Path

from dashred.config import load_config
from dashred.evaluation.case_rows import Case
from dashred.evaluation.twins.record_command import record

RECORDING, SEALED = "recording.nc", "sealed.nc"


def record_concealed(case: Case, noise: float, folder: Path) -> bytes:
    """Record a twin into a folder, and return its sealed truth, which is not on disk any more.

    Args:
        case: the twin and its seed.
        noise: std of the noise of the sensors, in std of what they read.
        folder: gets the recording.
    """
    words = [f"conf={case.system}", f"recording.twin={case.twin}", f"seed={case.seed}"]
    record(load_config([*words, f"recording.noise={noise:g}"], entry="record"), folder)
    sealed = (folder / SEALED).read_bytes()
    (folder / SEALED).unlink()
    return sealed
