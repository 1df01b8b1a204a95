"""Write ``estimator.nc``: what ``dashred follow`` needs of a run besides the corrected simulator.

It contains the readings that the run was made from, on their clock, with the noise and the role of
each sensor, and the weights of the corrected SHRED.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np

from dashred.core.files.atomic import write_netcdf_atomic
from dashred.data.io.write_netcdf import recording_dataset
from dashred.data.recording import Recording
from dashred.data.splits import Split
from dashred.models.shred import SHRED

NAME = "estimator.nc"
# Prefix of the names of the weights.
WEIGHT = "shred."
# Roles of the sensors, and those whose readings are not plain readings of the state.
ROLE, CHANGED = "role", "changed"


def write_estimator(
    path: Path,
    recording: Recording,
    axes: list[str],
    roles: Mapping[str, str],
    noise: Mapping[str, float],
    shred: SHRED,
    lags: int,
) -> None:
    """Write the file atomically.

    Args:
        path: the file.
        recording: readings of all sensors.
        axes: names of the axes of the system.
        roles: role of each sensor; the columns of the input of SHRED are those with ``input``.
        noise: σ of each sensor.
        shred: the network, on the CPU.
        lags: number of samples before the present one in a window of SHRED.
    """
    changed = [s.known != "" or s.factor != "" or s.is_calibrated for s in recording.sensors]
    sensors = tuple(replace(s, std=float(noise[s.name])) for s in recording.sensors)
    dataset = recording_dataset(replace(recording, sensors=sensors), axes)
    dataset[ROLE] = ("sensor", [roles[sensor.name] for sensor in sensors])
    dataset[CHANGED] = ("sensor", np.array(changed, dtype=np.int8))
    for name, weight in shred.state_dict().items():
        dims = [f"{name}.{i}" for i in range(weight.dim())]
        dataset[f"{WEIGHT}{name}"] = (dims, weight.numpy())
    dataset.attrs["lags"] = lags
    write_netcdf_atomic(path, dataset)


def whole_recording(split: Split) -> Recording:
    """Return the readings of all sensors at all times, put together from the parts of a split."""
    early = [split.fit, *([split.validation] if split.validate else [])]
    fitted = replace(
        split.fit,
        sensors=tuple(sensor for part in early for sensor in part.sensors),
        values=np.concatenate([part.values for part in early], axis=1),
    )
    late = split.heldout.select(fitted.names)
    times = np.concatenate([fitted.times, late.times])
    values = np.concatenate([fitted.values, late.values])
    sensors = (*fitted.sensors, *split.tested.sensors)
    return replace(
        split.fit,
        sensors=sensors,
        times=times,
        values=np.concatenate([values, split.tested.values], axis=1),
    )
