"""The sensors that an analysis with default splits fits.

A sensor that is held out has no part in the fit, so that nothing could be said about its error. The
sensor that errs is therefore one of those that are fitted.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import yaml

from dashred.config.bundled_systems import BASE
from dashred.config.schema.recording import SensorSplit, Splits, TimeSplit
from dashred.data.recording import Recording
from dashred.data.sensors import Sensor as RecordedSensor
from dashred.data.splits import split_recording
from dashred.evaluation.foreign.cases.case import Array, Sensor


def fitted_sensors(sensors: Sequence[Sensor], times: Array, seed: int) -> list[int]:
    """Return the indices of the fitted sensors.

    Args:
        sensors: of the recording.
        times: of the recording.
        seed: of the analysis, which draws the splits.
    """
    default = yaml.safe_load(BASE.read_text(encoding="utf-8"))["splits"]
    splits = Splits(SensorSplit(**default["sensors"]), TimeSplit(**default["time"]))
    recorded = tuple(RecordedSensor(s.name, s.field, s.position) for s in sensors)
    recording = Recording(recorded, times, np.zeros((len(times), len(sensors))))
    split = split_recording(recording, splits, seed)
    return [i for i, sensor in enumerate(sensors) if sensor.name in (*split.inputs, *split.extra)]
