"""The keys of ``recording`` and ``splits``: the sensor data, and what of them no fit may see."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Annotated, Any

from dashred.core.limits import Limit, NonNegative, Time, Unit


@dataclass(kw_only=True)
class Recording:
    """The sensor data: a twin's, or the user's own. The higher layer's choice of the two wins."""

    twin: str | None = None
    """Name of the twin experiment whose hidden truth is recorded; ``null`` is a twin too."""

    path: str | None = None
    """The user's own recording, CSV or NetCDF."""

    sensors: Any
    """Number of fit sensors of a twin; or the path of a sensors table of a CSV recording."""

    noise: Annotated[NonNegative, Unit("each field's standard deviation")]
    """Of twins: standard deviation of the noise."""

    duration: Time
    """Of twins: how long the recording lasts."""

    every: Time | None
    """Step between samples: twins are sampled so, finer recordings decimated to it; null keeps
    the recording's own step."""

    reads: list[str]
    """Of twins: the fields or lets that the sensors read; empty means every field."""

    drive: dict[str, str] = field(default_factory=dict)
    """Of twins: what drives each input, by its column, as an expression of t."""


@dataclass
class SensorSplit:
    """Which sensors the analysis must not fit. A number draws that many by the seed."""

    validate: Any
    """Sensors for early stopping and for choosing: a number, or a list of names."""

    test: Any
    """Sensors that prove the improvement and are never looked at before: number or names."""

    extra: Annotated[int, Limit(at_least=0)] | None
    """Fit sensors used in assimilation but not as SHRED's input; null takes a third of the fit
    sensors when there are at least 6, else none."""


@dataclass
class TimeSplit:
    """Which part of the record is held out."""

    test: Annotated[float, Limit(above=0, below=0.9), Unit("the record")]
    """Its last part, for testing only."""


@dataclass
class Splits:
    """What is held out, in space and in time."""

    sensors: SensorSplit
    time: TimeSplit
