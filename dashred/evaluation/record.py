"""A twin's recording in Python: what its sensors read, and nothing of its truth."""

from __future__ import annotations

import os
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from dashred.core.notebook_progress import display_here
from dashred.core.progress import shown_on
from dashred.pipeline.api.definition import from_file

if TYPE_CHECKING:
    import xarray as xr


def record(
    system: str | os.PathLike[str],
    twin: str,
    seed: int = 0,
    *,
    overrides: Mapping[str, Any] | None = None,
    progress: bool = False,
) -> xr.Dataset:
    """Record a twin: a hidden truth that obeys other laws than the simulator.

    Twins lie beside a system's configuration, in the folder ``twins``; those of the bundled systems
    come with a checkout of dashred, and not with an installed package.

    Args:
        system: the name of a bundled system, or the path of a YAML file.
        twin: the name of the twin.
        seed: of the sensors' places, the noise and the start.
        overrides: values over the configuration's, such as ``{"recording.noise": 0.01}``.
        progress: whether to show a bar.

    Returns:
        What the sensors read, ``value`` over ``(time, sensor)``; nothing of the truth.

    Raises:
        InputError: the system has no such twin, or no twins at all; or the truth blows up.
    """
    definition = from_file(system, {**(overrides or {}), "recording.twin": twin}, {}, None)
    config = definition.config(seed)

    # Imported late: what is wrong in the words is reported at once.
    from dashred.data.io.write_netcdf import recording_dataset
    from dashred.evaluation.twins.record_command import record_twin
    from dashred.pipeline.api.session import session

    with session(config), shown_on(display_here(progress)):
        recording, _, simulator = record_twin(config)
    return recording_dataset(recording, [axis.name for axis in simulator.axes])
