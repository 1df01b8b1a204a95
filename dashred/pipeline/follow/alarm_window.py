"""The samples since a change, as a recording that ``dashred train`` reads."""

from __future__ import annotations

import shlex
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from dashred.core.files.atomic import write_text_atomic
from dashred.data.sensors import Sensor
from dashred.inference.observer.live_inputs import LiveInputs
from dashred.physics.system import System
from dashred.pipeline.follow.rows import Rows
from dashred.pipeline.outputs.corrected_config import NAME as CORRECTED

Array = NDArray[np.float64]

# Longest recording of an alarm, in samples.
LONGEST = 20_000


class AlarmWindow:
    """A CSV with the readings since a change, to which the next samples are added.

    The table of its sensors is written beside it.

    Args:
        stem: path of the file without its ending; a number is added.
        system: the simulator.
        sensors: sensors with readings in the stream.
        columns: their columns in a sample.
        inputs: of the simulator, which get columns, too; None without any.
    """

    def __init__(
        self,
        stem: Path,
        system: System,
        sensors: Sequence[Sensor],
        columns: Sequence[int],
        inputs: LiveInputs | None,
    ) -> None:
        self.path = _free(stem)
        self.table = self.path.with_name(f"{self.path.stem}-sensors.csv")
        self._columns, self._inputs, self._count = [*columns], inputs, 0
        write_text_atomic(self.table, _table(system, sensors))
        driving = () if inputs is None else inputs.columns
        self._rows = Rows(self.path, ["time", *(sensor.name for sensor in sensors), *driving])

    def add(self, samples: Sequence[tuple[float, Array]]) -> None:
        """Add samples: a time and readings, ``(sensor,)``; at most so many as :data:`LONGEST`."""
        room = samples[: max(0, LONGEST - self._count)]
        self._count += len(room)
        self._rows.write([(self._row(time, values), ()) for time, values in room])

    def _row(self, time: float, values: Array) -> list[float]:
        driving = [] if self._inputs is None else self._inputs.at(time).tolist()
        return [time, *values[self._columns].tolist(), *driving]

    def close(self) -> None:
        """Close the file."""
        self._rows.close()

    def command(self, run: Path) -> str:
        """Return the command that analyses the window."""
        words = [
            "dashred",
            "train",
            f"conf={run / CORRECTED}",
            f"recording.path={self.path}",
            f"recording.sensors={self.table}",
        ]
        return shlex.join(words)


def _free(stem: Path) -> Path:
    """Return the first path ``STEM-1.csv``, ``STEM-2.csv``, … that does not exist."""
    number = 1
    while (path := stem.with_name(f"{stem.name}-{number}.csv")).exists():
        number += 1
    return path


def _table(system: System, sensors: Sequence[Sensor]) -> str:
    axes = [axis.name for axis in system.axes]
    wide = [f"{axis}_width" for axis in axes] if any(sensor.widths for sensor in sensors) else []
    rows = [["name", "field", *axes, *wide, "std"]]
    for sensor in sensors:
        widths = sensor.widths or (0.0,) * len(wide)
        numbers = [*sensor.position, *widths, sensor.std]
        rows.append([sensor.name, sensor.reads, *(f"{x:.12g}" for x in numbers)])
    return "".join(f"{','.join(row)}\n" for row in rows)
