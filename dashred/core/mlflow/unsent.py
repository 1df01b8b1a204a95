"""What a store has not taken of a stage that has ended: points of curves, and ended runs.

It is kept in a file, because the stage is not repeated when its run is resumed.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from dashred.core.files.atomic import write_text_atomic

if TYPE_CHECKING:
    from mlflow.entities import Metric


def add_unsent(path: Path, points: Mapping[str, Sequence[Metric]], ended: str) -> None:
    """Add points to the file, by run id, and the id of a run that has ended."""
    kept = _read(path)
    for run_id, waiting in points.items():
        rows = [[point.key, _plain(point.value), point.timestamp, point.step] for point in waiting]
        kept["points"].setdefault(run_id, []).extend(rows)
    kept["ended"].append(ended)
    path.parent.mkdir(parents=True, exist_ok=True)
    write_text_atomic(path, json.dumps(kept))


def read_unsent(path: Path) -> tuple[dict[str, list[Metric]], list[str]]:
    """Return the points in the file, by run id, and the ids of the runs that have ended."""
    from mlflow.entities import Metric

    kept = _read(path)
    points = {
        run_id: [
            Metric(key, math.nan if value is None else value, timestamp, step)
            for key, value, timestamp, step in rows
        ]
        for run_id, rows in kept["points"].items()
    }
    return points, kept["ended"]


def _read(path: Path) -> dict[str, Any]:
    if not path.is_file():
        return {"points": {}, "ended": []}
    return json.loads(path.read_text(encoding="utf-8"))


def _plain(value: float) -> float | None:
    return value if math.isfinite(value) else None
