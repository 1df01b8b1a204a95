"""Fields by method as a dataset and as a NetCDF file, for one or several episodes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import torch
import xarray as xr
from torch import Tensor

from dashred.core.files.atomic import write_netcdf_atomic
from dashred.physics.system import System
from dashred.pipeline.problem import Problem


def write_estimates(
    path: Path,
    system: System,
    times: Tensor,
    fields: Mapping[str, Tensor],
    episodes: Sequence[str] = (),
) -> None:
    """Write the dataset of :func:`fields_dataset`."""
    write_netcdf_atomic(path, fields_dataset(system, times, fields, episodes))


def fields_dataset(
    system: System, times: Tensor, fields: Mapping[str, Tensor], episodes: Sequence[str] = ()
) -> xr.Dataset:
    """Return the fields by method: one variable per field over ``(method, time, *axes)``.

    Args:
        system: system with its field names and its grid.
        times: times, ``(time,)``.
        fields: fields by method, ``(time, field, *grid)``.
        episodes: name of the episode of each time; empty for a single episode.
    """
    stacked = system.grid.own(torch.stack(list(fields.values()))).numpy()
    data = {
        name: (("method", "time", *system.grid.dimensions), stacked[:, :, i].astype(np.float64))
        for i, name in enumerate(system.fields)
    }
    coordinates: dict[str, Any] = {"method": list(fields), "time": times.numpy()}
    if len(episodes):
        coordinates["episode"] = ("time", list(episodes))
    coordinates |= {name: (along, x.numpy()) for name, (along, x) in system.grid.labels.items()}
    return xr.Dataset(data, coordinates)


def episodes_dataset(parts: Sequence[tuple[Problem, Tensor, dict[str, Tensor]]]) -> xr.Dataset:
    """Return the fields by method of several episodes, joined along time."""
    system = parts[0][0].system
    if len(parts) == 1:
        [(_, times, fields)] = parts
        return fields_dataset(system, times, fields)
    methods = [name for name in parts[0][2] if all(name in fields for *_, fields in parts)]
    joined = {name: torch.cat([fields[name] for *_, fields in parts]) for name in methods}
    labels = [episode.name for episode, times, _ in parts for _ in times]
    return fields_dataset(system, torch.cat([t for _, t, _ in parts]), joined, labels)
