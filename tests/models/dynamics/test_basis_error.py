"""What a basis cannot express of a simulation."""

from __future__ import annotations

import pytest
import torch

from dashred.data.observation_operator import ObservationOperator
from dashred.models.dynamics.basis_error import basis_error
from dashred.models.pod import POD
from dashred.physics.solvers.sample_step import SampleStep
from tests import ring
from tests.models.dynamics.test_dynamic_assimilation import data, make, real, shred, system

__all__ = ["data", "real", "shred", "system"]


@pytest.mark.parametrize(("modes", "expressed"), [(7, True), (3, False)])
def test_it_is_zero_where_the_basis_has_all(system, shred, data, real, modes, expressed) -> None:
    dynamics = make(system, shred, data).dynamics
    states = ring.ensemble(system, 12).states
    assert isinstance(states, torch.Tensor)
    pod = POD.fit(states.flatten(0, 1), modes)
    operator = ObservationOperator(ring.SENSORS, system)
    accurate = SampleStep(system, 0.1)
    found = basis_error(pod, operator, dynamics, accurate, real)
    left = real - pod.decode(pod.encode(real))
    torch.testing.assert_close(found.readings, operator(left).square().mean(dim=0).sqrt())
    if expressed:
        assert float(found.readings.max()) < 1e-6 and found.step < 1e-6
    else:
        assert float(found.readings.max()) > 1e-2 and 0 < found.step < 1
    # The time step is that of the simulator.
    assert found.scheme < 1e-6
