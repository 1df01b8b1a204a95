"""The kinds of faults that are searched: how to find candidates, and how to tell them in units."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator
from dataclasses import dataclass

from torch import Tensor

from dashred.inference.fit.law import SensorFault
from dashred.inference.fit.least_squares import LeastSquaresProblem
from dashred.inference.sensor_faults import lost_samples, offset_faults
from dashred.inference.sensor_faults.fault import Alternatives, Fault
from dashred.inference.sensor_faults.linearised_fit import LinearisedFit

Candidates = Callable[[LeastSquaresProblem, LinearisedFit, int], Iterator[Alternatives]]
"""Yields the faults that a sensor may have; a linearised fit gives the other sensors' judgement."""

InUnits = Callable[[LeastSquaresProblem, Fault, Tensor, Tensor], SensorFault]
"""Returns a fault with given parameters and their covariance in the user's units."""


@dataclass(frozen=True)
class SearchedKind:
    """How one kind of fault is searched and told."""

    candidates: Candidates
    in_units: InUnits


# The keys are those of dashred.core.findings.fault_kinds.FAULT_KINDS, which holds the wording.
SEARCHED_KINDS = {
    "bias": SearchedKind(offset_faults.bias, offset_faults.bias_in_units),
    "drift": SearchedKind(offset_faults.drift, offset_faults.drift_in_units),
    "stuck": SearchedKind(lost_samples.stuck, lost_samples.stuck_in_units),
    "spikes": SearchedKind(lost_samples.spikes, lost_samples.spikes_in_units),
    "misplaced": SearchedKind(offset_faults.misplaced, offset_faults.misplaced_in_units),
    "wandering": SearchedKind(offset_faults.wandering, offset_faults.wandering_in_units),
}
# Faults that neither a law nor an inaccurate model imitates.
DISTINCT_KINDS = ("stuck", "spikes")


def fault_candidates(
    objective: LeastSquaresProblem, linear: LinearisedFit, sensor: int, kinds: Collection[str]
) -> Iterator[Alternatives]:
    """Yield the faults that a sensor may have.

    Args:
        objective: F of a law that may be right.
        linear: F linearised about its fit.
        sensor: column of the sensor in the readings.
        kinds: the kinds of faults.
    """
    for kind in kinds:
        yield from SEARCHED_KINDS[kind].candidates(objective, linear, sensor)


def fault_in_units(
    objective: LeastSquaresProblem, fault: Fault, parameters: Tensor, covariance: Tensor
) -> SensorFault:
    """Return a fault in the user's units.

    Args:
        objective: F of the law.
        fault: the fault.
        parameters: its parameters, ``(parameter,)``.
        covariance: their posterior covariance, ``(parameter, parameter)``.
    """
    return SEARCHED_KINDS[fault.kind].in_units(objective, fault, parameters, covariance)
