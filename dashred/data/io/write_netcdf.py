"""Writer of NetCDF recordings: CF time series at fixed points, dims ``(time, sensor)``."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from dashred.core.files.atomic import write_netcdf_atomic
from dashred.core.units import TIME
from dashred.data.episodes import Episodes
from dashred.data.recording import Recording

if TYPE_CHECKING:
    import xarray as xr


def write_netcdf(
    recorded: Recording | Episodes, path: str | Path, axes: Sequence[str] = ("x", "y", "z")
) -> None:
    """Write a recording atomically; equal recordings give equal bytes.

    Args:
        recorded: what to write.
        path: the file, which is replaced if it exists.
        axes: names of the system's axes, at least as many as the sensors have coordinates.
    """
    write_netcdf_atomic(Path(path), recording_dataset(recorded, axes))


def recording_dataset(
    recorded: Recording | Episodes, axes: Sequence[str] = ("x", "y", "z")
) -> xr.Dataset:
    """Return a recording as a dataset.

    Variables: ``value`` (time, sensor), ``time``, and along ``sensor``: ``name``, ``reads``,
    ``std`` (NaN if unknown), ``unit`` if any is stated (empty if unknown) and one coordinate per
    axis. Measured inputs are along ``input_time``, their own clock. All other units are attributes
    ``units``. Several episodes are concatenated; ``episode`` and ``input_episode`` give the
    episode of every sample.

    Args:
        recorded: the recording.
        axes: names of the system's axes, at least as many as the sensors have coordinates.
    """
    import xarray as xr  # takes a second, which readers of CSV need not wait for

    named = dict(_named(recorded))
    parts = list(named.values())
    sensors, inputs, units = parts[0].sensors, parts[0].inputs.values, parts[0].units

    def of(name: str) -> dict[str, str]:
        return {"units": units[name]} if name in units else {}

    read = [units.get(sensor.reads, "") for sensor in sensors]
    places = {
        axes[index]: ("sensor", [sensor.position[index] for sensor in sensors], of(axes[index]))
        for index in range(len(sensors[0].position))
    }
    if any(sensor.widths for sensor in sensors):
        for index, axis in enumerate(places.copy()):
            wide = [sensor.widths[index] if sensor.widths else 0.0 for sensor in sensors]
            places[f"{axis}_width"] = ("sensor", wide, of(axis))
    stds = [math.nan if sensor.std is None else sensor.std for sensor in sensors]
    clocks = {"time": [part.times for part in parts]}
    if inputs:
        clocks["input_time"] = [part.inputs.times for part in parts]
    labels = {"time": "episode", "input_time": "input_episode"}
    return xr.Dataset(
        {
            "value": (("time", "sensor"), np.concatenate([part.values for part in parts])),
            **{
                column: ("input_time", np.concatenate([p.inputs.values[column] for p in parts]))
                for column in inputs
            },
        },
        coords={
            **{clock: (clock, np.concatenate(times), of(TIME)) for clock, times in clocks.items()},
            **{
                labels[clock]: (clock, np.repeat([*named], [len(part) for part in times]))
                for clock, times in clocks.items()
                if isinstance(recorded, Episodes)
            },
            "name": ("sensor", list(parts[0].names), {"cf_role": "timeseries_id"}),
            "reads": ("sensor", [sensor.reads for sensor in sensors]),
            "std": ("sensor", stds),
            **({"unit": ("sensor", read)} if any(read) else {}),
            **places,
        },
        attrs={"Conventions": "CF-1.11", "featureType": "timeSeries"},
    )


def _named(recorded: Recording | Episodes) -> list[tuple[str, Recording]]:
    if isinstance(recorded, Recording):
        return [("", recorded)]
    return [(episode.name, episode.recording) for episode in recorded.episodes]
