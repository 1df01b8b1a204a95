"""The keys of ``recording`` and ``splits``: the sensor data, and which part is held out."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Annotated, Any

from dashred.core.limits import Limit, NonNegative, Time, Unit


@dataclass(kw_only=True)
class Recording:
    """The sensor data: a twin's, or the user's own. The command line overrides the file."""

    twin: str | None = None
    """Name of the twin experiment to record; ``null`` is the name of a twin, too."""

    path: str | None = None
    """Path of the user's own recording, CSV or NetCDF."""

    sensors: Any
    """Number of fit sensors of a twin, or path of the table of sensors of a CSV recording."""

    noise: Annotated[NonNegative, Unit("each field's standard deviation")]
    """For twins: standard deviation of the noise."""

    duration: Time
    """For twins: length of the recording."""

    std: Any
    """Standard deviation of the noise of the sensors of the user's own recording: a number in the
    unit of what they read, or a share of the standard deviation of their readings such as 5%. A
    noise that depends on the reading is ``5% of reading``, ``0.01 + 5% of reading`` (both parts are
    independent), or ``counts``, whose variance is their mean. One for all sensors, or by name of a
    sensor or of what it reads. It overrides the table of sensors; what neither states is estimated
    from the readings."""

    calibration: Any
    """Sensors of the user's own recording that are not calibrated: they read ``gain*y + offset`` of
    the quantity y. By name of a sensor or of what it reads, such as
    ``S1: {gain: 0.1, offset: fitted}``. A number is the spread of the gain about 1, or of the
    offset about 0; ``fitted`` means that nothing is known; ``{value: 12, spread: 2}`` gives another
    value. They are fitted together with the state, and such a sensor is not held out."""

    average: Any
    """Time over which sensors of the user's own recording average, up to the time of the sample:
    a number in the system's time, or ``interval`` for the time since the sample before. One for all
    sensors, or by name of a sensor or of what it reads. Null for instantaneous readings."""

    every: Time | None
    """Step between samples. Twins are sampled at this step; finer recordings are resampled to it.
    Null keeps the recording's own step, and the times of an ODE recording as they are. In a table
    without times it is the step from row to row."""

    begin: Any
    """First time of the part of the user's own recording that is used, to leave out a start-up: a
    number in the system's time, or a date where the recording has dates. The clock remains that of
    the recording, so t begins at this time. The same for all episodes, each on its own clock. Null
    for the first sample."""

    end: Any
    """Last time of the part of the user's own recording that is used, like ``begin``. A date alone
    is its midnight. Null for the last sample."""

    columns: Any
    """Names of the columns of a table: a list of all, `[time, T, u]`, for a table without a header;
    or the header of some by the names that they have here, `{time: Zeit, T: Temperature 1}`; in a
    table without a header, the number of a column is its header. The names `time` and `episode`
    have a meaning of their own. In a table with one row for each reading, `sensor` is the column
    with the name of the sensor and `value` that with the reading; the other names may be those of
    sensors, by the name in that column."""

    ignore: list[str]
    """Columns of a table that are not read. Without this list, a column that is neither a sensor
    nor an input is left out, unless its name is close to that of a sensor."""

    angles: list[str]
    """Sensors whose readings jump by a full turn, or what they read: an encoder that counts from
    -pi to pi. The readings are continued across the jump. An angle without a unit is in radians."""

    reads: list[str]
    """For twins: fields or lets that the sensors read; empty means every field."""

    drive: dict[str, str] = field(default_factory=dict)
    """For twins: signal of each input, by column, as an expression in t."""


@dataclass
class SensorSplit:
    """Sensors that are not fitted. A number is drawn with the seed. At least four stay fitted."""

    validate: Any
    """Sensors for early stopping and model selection: a number, or a list of names."""

    test: Any
    """Sensors for testing, which are not used before discovery is final: a number, or a list of
    names."""

    extra: Annotated[int, Limit(at_least=0)] | None
    """Number of fit sensors that are used in assimilation but not as SHRED's input; null takes a
    third of the fit sensors if there are at least 6, else none."""


@dataclass
class TimeSplit:
    """The held-out part of the recording."""

    test: Annotated[float, Limit(above=0, below=0.9), Unit("the record")]
    """Share of the recording, at its end, that is used for testing only."""


@dataclass
class Splits:
    """Held-out data, in space and in time."""

    sensors: SensorSplit
    time: TimeSplit
