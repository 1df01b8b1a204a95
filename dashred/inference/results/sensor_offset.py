"""The errors of the sensors according to an explanation."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from torch import Tensor

from dashred.inference.fit.law import Law


def sensor_offset(law: Law, names: Sequence[str], elapsed: Tensor) -> NDArray[np.float64]:
    """Return the error of each sensor, ``(time, sensor)``; NaN where its readings are left out.

    A single sensor is never left out, because nothing would remain.

    Args:
        law: the explanation, which may contain faults of sensors.
        names: names of the sensors.
        elapsed: times after the first sample of the episode, ``(time,)``.
    """
    offset = np.zeros((len(elapsed), len(names)))
    for fault in law.faults:
        if fault.sensor not in names:
            continue
        error, column = fault.offset(elapsed), list(names).index(fault.sensor)
        if error is not None:
            offset[:, column] = error.numpy()
        elif len(names) > 1:
            offset[:, column] = np.nan
    return offset
