"""Recordings in NetCDF: dims (time, sensor), named as CF does for series at fixed points."""

from __future__ import annotations

import math
import os
import tempfile
from collections.abc import Sequence
from pathlib import Path

from dashred.sensing.recording import Recording
from dashred.units import TIME


def write_netcdf(
    recording: Recording, path: str | Path, axes: Sequence[str] = ("x", "y", "z")
) -> None:
    """Write a recording at once or not at all; equal recordings give equal bytes.

    Variables: ``value`` (time, sensor), ``time``, and along ``sensor``: ``name``, ``reads``,
    ``std`` (NaN if unknown), ``unit`` where any is stated (empty if unknown) and one coordinate for
    each axis; along ``input_time``, a clock of their own, the measured inputs, if there are any.
    Units of the others are attributes ``units``.

    Args:
        recording: what to write.
        path: the file, which is replaced if it exists.
        axes: names of the system's axes, at least as many as the sensors have coordinates.
    """
    import xarray as xr  # takes a second, which reading a CSV need not wait for

    sensors, inputs, units = recording.sensors, recording.inputs, recording.units

    def of(name: str) -> dict[str, str]:
        return {"units": units[name]} if name in units else {}

    read = [units.get(sensor.reads, "") for sensor in sensors]
    places = {
        axes[index]: ("sensor", [sensor.position[index] for sensor in sensors], of(axes[index]))
        for index in range(len(sensors[0].position))
    }
    stds = [math.nan if sensor.std is None else sensor.std for sensor in sensors]
    dataset = xr.Dataset(
        {
            "value": (("time", "sensor"), recording.values),
            **{column: ("input_time", found) for column, found in inputs.values.items()},
        },
        coords={
            "time": ("time", recording.times, of(TIME)),
            **({"input_time": ("input_time", inputs.times, of(TIME))} if inputs.values else {}),
            "name": ("sensor", list(recording.names), {"cf_role": "timeseries_id"}),
            "reads": ("sensor", [sensor.reads for sensor in sensors]),
            "std": ("sensor", stds),
            **({"unit": ("sensor", read)} if any(read) else {}),
            **places,
        },
        attrs={"Conventions": "CF-1.11", "featureType": "timeSeries"},
    )
    target = Path(path)
    with tempfile.TemporaryDirectory(dir=target.parent, prefix=".writing-") as folder:
        unfinished = Path(folder) / target.name
        dataset.to_netcdf(unfinished, engine="h5netcdf")
        os.replace(unfinished, target)
