"""Errors of readings and steps of a simulation that is restricted to the POD basis."""

from __future__ import annotations

from typing import NamedTuple

import torch
from jaxtyping import Float
from torch import Tensor

from dashred.data.observation_operator import ObservationOperator
from dashred.models.dynamics.sampled_dynamics import SampledDynamics
from dashred.models.pod import POD
from dashred.physics.solvers.sample_step import SampleStep


class BasisError(NamedTuple):
    """Errors of a field that is restricted to the basis.

    Attributes:
        readings: RMS error of the readings of each sensor, ``(sensor,)``.
        step: largest RMS of the error of a step in the basis, in std of a field.
        scheme: the part of it that a longer time step makes, which no basis can remove.
    """

    readings: Float[Tensor, " sensor"]
    step: float
    scheme: float


@torch.no_grad()
def basis_error(
    pod: POD,
    operator: ObservationOperator,
    dynamics: SampledDynamics,
    accurate: SampleStep,
    states: Float[Tensor, "time field *grid"],
) -> BasisError:
    """Compare readings and steps of states with those of the states in the basis.

    The error of readings is the representativeness error of data assimilation. With the projection
    P on the basis, and Φ* the simulator with its own time step, the error of a step is
    ``P Φ(P u) − P Φ*(u)``, and that of the scheme ``P Φ(u) − P Φ*(u)``. States from which the
    simulator blows up are left out.

    Args:
        pod: the basis.
        operator: of the sensors.
        dynamics: the simulator, without a law, perhaps with a longer time step.
        accurate: Φ*, with the inputs of the first episode.
        states: of the simulation, at the samples of the first episode.
    """
    expressed = pod.decode(pod.encode(states))
    readings = (operator(expressed) - operator(states)).square().mean(dim=0).sqrt()
    step = scheme = 0.0
    for block in dynamics.blocks():
        if block.episode is not dynamics.episodes[0]:
            break
        rows = slice(block.rows.start, block.rows.stop - 1)
        true = pod.encode(accurate(states[rows].double(), block.begins, block.durations, None))
        step = max(step, _largest(pod, dynamics.advance(block, expressed[rows]), true))
        scheme = max(scheme, _largest(pod, dynamics.advance(block, states[rows]), true))
    return BasisError(readings, step, scheme)


def _largest(pod: POD, forecasts: Tensor, true: Tensor) -> float:
    """Return the largest RMS error of the forecasts in the basis, in std of a field."""
    size = (pod.encode(forecasts) - true).square().sum(dim=1) / pod.modes.shape[1]
    return max([0.0, *size[size.isfinite()].sqrt().tolist()])
