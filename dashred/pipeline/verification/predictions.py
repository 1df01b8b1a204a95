"""Predictions of recorded values by every method, on data that no fit has used."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from dashred.data.recording import Recording
from dashred.inference.fit.law import Law
from dashred.inference.results.sensor_offset import sensor_offset
from dashred.pipeline.problem import Problem
from dashred.pipeline.trajectories import UNPREDICTABLE_GROWTH

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Predictions:
    """Readings that the methods predict at times that were not fitted.

    Attributes:
        times: of the readings, ``(time,)``.
        recorded: recorded values, ``(time, sensor)``; NaN where missing, and at a sensor that the
            explanation leaves out.
        scale: standard deviation of each trace, ``(sensor,)``.
        read: readings of the simulated states by method, ``(time, sensor)``.
        offset: error of the sensors according to the explanation, ``(time, sensor)``.
        is_predictable: whether a small error of the start stays small over the recording.
        is_lost: whether the corrected run is lost before these times begin.
    """

    times: Array
    recorded: Array
    scale: Array
    read: dict[str, Array]
    offset: Array
    is_predictable: bool
    is_lost: bool = False

    def errors(self, method: str) -> Array:
        """Return the errors of a method in units of the scale, ``(time, sensor)``.

        The corrected simulator contains the errors of the sensors; the other methods do not.
        """
        offset = self.offset if method == "corrected" else 0.0
        return (self.read[method] + offset - self.recorded) / self.scale

    def with_same_sensors(self) -> Predictions:
        """Return the predictions with the sensors corrected for every method."""
        offset = np.zeros_like(self.offset)
        return replace(self, recorded=self.recorded - self.offset, offset=offset)

    def truncate(self, samples: int) -> Predictions:
        """Return the predictions of the first samples."""
        return replace(
            self,
            times=self.times[:samples],
            recorded=self.recorded[:samples],
            read={method: values[:samples] for method, values in self.read.items()},
            offset=self.offset[:samples],
        )


def predict(
    problem: Problem,
    recording: Recording,
    scale: Array,
    law: Law,
    states: Mapping[str, Tensor],
    growth_rate: float,
) -> Predictions:
    """Return the predictions of an episode.

    Args:
        problem: the episode.
        recording: the sensors and times that are compared.
        scale: standard deviation of each trace, ``(sensor,)``.
        law: the explanation; its sensor fault is subtracted from the readings, or the readings of
            that sensor are left out.
        states: by method, ``(time, field, *grid)`` at the times of the recording.
        growth_rate: rate at which a small error of the start grows, in 1/time.
    """
    duration = float(problem.times[-1] - problem.times[0])
    growth = math.exp(min(growth_rate * duration, 700.0))
    elapsed = torch.from_numpy(recording.times) - problem.times[0]
    offset = sensor_offset(law, recording.names, elapsed)
    recorded = np.where(np.isnan(offset), np.nan, recording.values)
    read = {name: problem.operator(recording)(path).numpy() for name, path in states.items()}
    return Predictions(
        recording.times,
        recorded,
        scale,
        read,
        np.nan_to_num(offset),
        growth <= UNPREDICTABLE_GROWTH,
    )
