"""Record a twin in Python: the readings of its sensors, without its truth."""

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
    """Record a twin, a hidden truth with other laws than the simulator.

    Twins are in the folder ``twins`` next to the configuration of their system. Those of bundled
    systems are part of a checkout of dashred, but not of an installed package.

    Args:
        system: the name of a bundled system, or the path of a YAML file.
        twin: the name of the twin.
        seed: seed of the sensor positions, the noise and the start.
        overrides: values that replace configured ones, such as ``{"recording.noise": 0.01}``.
        progress: whether to show a progress bar.

    Returns:
        The readings, ``value`` over ``(time, sensor)``, without the truth.

    Raises:
        InputError: the system does not have the twin, or the truth blows up.
    """
    definition = from_file(system, {**(overrides or {}), "recording.twin": twin}, {}, None)
    config = definition.config(seed)

    # Imported late, so that wrong arguments are reported at once.
    from dashred.data.io.write_netcdf import recording_dataset
    from dashred.evaluation.twins.record_command import record_twin
    from dashred.pipeline.api.session import session

    with session(config), shown_on(display_here(progress)):
        recording, _, simulator = record_twin(config)
    return recording_dataset(recording, [axis.name for axis in simulator.axes])
