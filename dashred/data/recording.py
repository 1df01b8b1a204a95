"""A recording: sensor values at sample times, with measured inputs and units."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from dashred.core.errors import InputError, nearest
from dashred.data.sensors import Sensor
from dashred.physics.backends.input_signals import NO_INPUTS, InputSignals


@dataclass(frozen=True, eq=False)
class Recording:
    """Values of S sensors at T times.

    Attributes:
        sensors: one for each column of ``values``, with unique names.
        times: (time,) float64, strictly increasing, in the unit of the system's ``t``.
        values: (time, sensor) float64, in the unit of what each sensor reads; NaN is missing.
        inputs: measured inputs of the system, by column, on their own clock.
        units: stated in the files, by name in the equations; the unit of time is under ``t``.
    """

    sensors: tuple[Sensor, ...]
    times: NDArray[np.float64]
    values: NDArray[np.float64]
    inputs: InputSignals = NO_INPUTS
    units: Mapping[str, str] = field(default_factory=dict)

    def __post_init__(self) -> None:
        """Check shapes and the order of times; the readers validate the contents of files."""
        if self.values.shape != (*self.times.shape, len(self.sensors)) or self.times.ndim != 1:
            raise ValueError(f"values {self.values.shape} do not fit times {self.times.shape}")
        if not np.all(np.diff(self.times) > 0):
            raise ValueError("times must increase strictly")

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the sensors, in the order of the columns."""
        return tuple(sensor.name for sensor in self.sensors)

    def select(self, names: Sequence[str]) -> Recording:
        """Return a recording of the named sensors only, in the given order.

        Raises:
            InputError: for a name that is not in the recording.
        """
        columns = {name: column for column, name in enumerate(self.names)}
        for name in names:
            if name not in columns:
                problem = f"the recording has no sensor {name!r}"
                raise InputError(problem, hint=nearest(name, self.names))
        chosen = [columns[name] for name in names]
        sensors = tuple(self.sensors[column] for column in chosen)
        return replace(self, sensors=sensors, values=self.values[:, chosen])

    def is_read(self) -> NDArray[np.bool_]:
        """Return whether each sensor has a value at any time, ``(sensor,)``."""
        found: NDArray[np.bool_] = np.asarray(~np.isnan(self.values).all(axis=0))
        return found

    def trace_std(self) -> NDArray[np.float64]:
        """Return the std of each trace, ``(sensor,)``; 0 if it is constant or has no values."""
        seen = ~np.isnan(self.values)
        count = np.maximum(seen.sum(axis=0), 1)
        mean = np.where(seen, self.values, 0.0).sum(axis=0) / count
        squares = np.where(seen, self.values - mean, 0.0) ** 2
        return np.sqrt(squares.sum(axis=0) / count)

    def trace_scale(self) -> NDArray[np.float64]:
        """Return the std of each trace, ``(sensor,)``; 1 if it is constant."""
        std = self.trace_std()
        return np.where(std > 0, std, 1.0)

    def between(self, first: float, last: float) -> Recording:
        """Return the samples with ``first <= time <= last``."""
        inside = (self.times >= first) & (self.times <= last)
        return replace(self, times=self.times[inside], values=self.values[inside])

    def samples(self, part: slice) -> Recording:
        """Return some of the samples."""
        return replace(self, times=self.times[part], values=self.values[part])

    def sha256(self) -> str:
        """Hash of the contents (sensors, times, values), independent of the file format."""
        sensors = [[s.name, s.reads, list(s.position), s.std] for s in self.sensors]
        shares = [s.std_share for s in self.sensors if s.std_share is not None]
        laws = [s.noise_law for s in self.sensors if s.noise_law is not None]
        regions = [[s.name, *s.widths] for s in self.sensors if s.widths]
        digest = hashlib.sha256(json.dumps(sensors + shares + laws + regions).encode())
        digest.update(self.times.astype("<f8").tobytes())
        # Use one NaN for all missing values: its bits differ between file formats.
        digest.update(np.where(np.isnan(self.values), np.nan, self.values).astype("<f8").tobytes())
        for column, values in self.inputs.values.items():
            digest.update(column.encode() + self.inputs.times.astype("<f8").tobytes())
            digest.update(values.astype("<f8").tobytes())
        if self.units:
            digest.update(json.dumps(self.units, sort_keys=True).encode())
        return digest.hexdigest()
