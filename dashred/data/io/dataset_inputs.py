"""Inputs of a dataset in the layout of :mod:`.write_netcdf`, with their clock."""

from __future__ import annotations

from collections.abc import Sequence
from datetime import UTC, datetime
from typing import TYPE_CHECKING

import numpy as np

from dashred.core.errors import InputError
from dashred.core.units import TIME
from dashred.data.checks import check_input
from dashred.data.episodes import EpisodeRows
from dashred.data.io.dataset_variables import episode_rows, in_system_unit, sample_location
from dashred.data.io.stated_units import StatedUnits
from dashred.physics.backends.input_signals import InputSignals

if TYPE_CHECKING:
    import xarray as xr


def inputs_of_dataset(
    dataset: xr.Dataset, stated: StatedUnits, parts: Sequence[EpisodeRows], path: str
) -> list[InputSignals]:
    """Return the inputs of every episode by column, on their own or on the recording's clock."""
    clock, input_parts = "time", list(parts)
    if "input_time" in dataset.variables:
        clock = "input_time"
        input_parts = episode_rows(dataset, "input_episode", "input_time", path)
    names = [[part.name for part in found] for found in (parts, input_parts)]
    if len(parts) != len(input_parts) or (len(parts) > 1 and names[0] != names[1]):
        problem = "the inputs and the samples have different episodes"
        hint = "use the same episodes in the same order for both"
        raise InputError(problem, where=f"{path}, 'input_episode'", hint=hint)
    system = stated.system
    times = in_system_unit(dataset, clock, (clock,), TIME, stated, path)
    columns = {
        column: in_system_unit(dataset, column, (clock,), name, stated, path)
        for name, column in system.inputs.items()
    }
    for name, column in system.inputs.items():
        check_input(name, column, columns[column], lambda at, of: sample_location(path, at, of))
    # The recording's own clock is checked with the samples.
    if clock == "input_time" and system.inputs:
        _check_epochs(dataset, path)
        for part in input_parts:
            own = times[part.rows]
            if not np.all(np.isfinite(own)) or not np.all(np.diff(own) > 0):
                raise InputError(f"{clock!r} does not increase", where=part.location(path))
    return [
        InputSignals(times[part.rows], {name: found[part.rows] for name, found in columns.items()})
        for part in input_parts
    ]


def _check_epochs(dataset: xr.Dataset, path: str) -> None:
    """Check that the clocks of samples and inputs have the same epoch.

    Raises:
        InputError: the epochs differ.
    """
    since = [_since(dataset, clock) for clock in ("time", "input_time")]
    if all(since) and _moment(since[0]) != _moment(since[1]):
        problem = f"'input_time' counts since {since[1]}, but 'time' counts since {since[0]}"
        hint = "use the same epoch for both: times are not converted"
        raise InputError(problem, where=f"{path}, 'input_time'", hint=hint)


def _since(dataset: xr.Dataset, clock: str) -> str:
    """Return the epoch in ``seconds since 2020-01-01``, or '' if there is none."""
    return str(dataset[clock].attrs.get("units", "")).partition(" since ")[2].strip()


def _moment(text: str) -> datetime | str:
    """Return an epoch as a datetime, or the text itself if it is not an ISO date."""
    try:
        moment = datetime.fromisoformat(text)
    except ValueError:
        return " ".join(text.split())
    return moment if moment.tzinfo else moment.replace(tzinfo=UTC)
