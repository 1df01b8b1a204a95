"""Export the corrected SHRED of a run as a graph that torch alone loads."""

from __future__ import annotations

import json
from pathlib import Path

import torch

from dashred.core.files.atomic import atomic_file
from dashred.models.quiet_export import quiet_export
from dashred.pipeline.follow.finished_run import FinishedRun

# Name of the description in the file, and the number of windows in the example: with only one, the
# graph would be specialised to batches of one.
DESCRIPTION, EXAMPLES = "dashred.json", 2


def export_surrogate(path: Path, run: FinishedRun) -> None:
    """Write the network, float32 ``(batch, lag, sensor)`` → ``(batch, field, *grid)``.

    ``torch.export.load(path).module()`` is the function. The file also contains the names of the
    sensors and fields, the number of samples in a window and their step.
    """
    shred = run.shred
    example = torch.zeros((EXAMPLES, run.lags + 1, len(run.network_sensors)))
    batch = torch.export.Dim("batch")
    with quiet_export():
        program = torch.export.export(shred, (example,), dynamic_shapes=({0: batch},))
    about = {
        "sensors": [run.names[index] for index in run.network_sensors],
        "fields": list(run.system.fields),
        "window": run.lags + 1,
        "step": run.step,
    }
    # An open file, because torch.export expects its own ending in a name.
    with atomic_file(path) as partial, partial.open("wb") as file, quiet_export():
        torch.export.save(program, file, extra_files={DESCRIPTION: json.dumps(about)})
