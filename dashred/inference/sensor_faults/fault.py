"""A fault of one sensor, and the penalty for its degrees of freedom."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Protocol

import torch
from torch import Tensor

from dashred.core.findings.fault_kinds import FAULT_KINDS
from dashred.inference.fit.least_squares import LeastSquaresProblem
from dashred.inference.forward.sensor_block import SensorErrors


class Complexity(Protocol):
    """How many degrees of freedom a fault has."""

    def penalty(self, information: Tensor, samples: float) -> float:
        """Return the penalty of the parameters in the score.

        Args:
            information: curvature of F/2 in the parameters without their prior, all other unknowns
                at their minimum, ``(parameter, parameter)``.
            samples: effective number of samples.
        """


@dataclass(frozen=True)
class CountedParameters:
    """A few parameters of any size: ``k ln n``."""

    count: float

    def penalty(self, information: Tensor, samples: float) -> float:
        """Return ``k ln n``."""
        return self.count * math.log(samples)


@dataclass(frozen=True)
class MarginalAmplitudes:
    """Many amplitudes with a prior: Laplace's evidence ``ln det(I + T S T)``, T the prior stds.

    Attributes:
        scales: prior standard deviation of every amplitude, ``(amplitude,)``.
        choices: number of priors among which this one was chosen.
    """

    scales: Tensor
    choices: int

    def penalty(self, information: Tensor, samples: float) -> float:
        """Return ``ln det(I + T S T) + 2 ln choices``."""
        scaled = self.scales[:, None] * information * self.scales
        eye = torch.eye(len(scaled), dtype=scaled.dtype)
        return float(torch.logdet(eye + scaled)) + 2 * math.log(self.choices)


@dataclass(frozen=True)
class Fault:
    """A possible fault of one sensor.

    Attributes:
        kind: a key of :data:`dashred.core.findings.fault_kinds.FAULT_KINDS`.
        sensor: index of the sensor; with several episodes, of its column in one of them.
        complexity: its degrees of freedom.
        errors: errors of the readings, with parameters; None if the fault only removes samples.
        samples: mask of the samples that are not readings of the system, ``(time,)``, in one
            episode; None for no sample.
        constant: contribution of these samples to F.
    """

    kind: str
    sensor: int
    complexity: Complexity
    errors: SensorErrors | None = None
    samples: Tensor | None = None
    constant: float = 0.0

    def penalty(self, information: Tensor, samples: float, sensors: int) -> float:
        """Return the penalty for its parameters and for the choice of its kind and sensor."""
        return self.complexity.penalty(information, samples) + choice_penalty(sensors)


def choice_penalty(sensors: int) -> float:
    """Return the penalty for the choice of a fault's kind and sensor, without its parameters."""
    return 2 * math.log(len(FAULT_KINDS) * sensors)


Alternatives = tuple[Fault, ...]
"""One fault with different priors of its parameters."""


def count_sensors(objective: LeastSquaresProblem) -> int:
    """Return the number of sensors with readings; a sensor counts once for all episodes."""
    sensors, seen = objective.forward_model.sensors.sensors, objective.noise.available.any(dim=0)
    return len({s.name for s, is_seen in zip(sensors, seen.tolist(), strict=True) if is_seen})
