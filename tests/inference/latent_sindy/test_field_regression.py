"""Regression of a simulator's errors in the leading POD coefficients, with the true field."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from dashred.inference.latent_sindy.field_regression import field_regression
from dashred.inference.latent_sindy.sparse_regression import sparse_fit
from dashred.inference.latent_sindy.step_sensitivities import SimulatorSteps
from dashred.models.pod import POD
from dashred.physics.runs.ensemble import term_scales
from dashred.physics.solvers.simulate import simulate
from tests import ring

pytestmark = pytest.mark.positive_control
BEGINS = torch.arange(0, 36, 3)


@pytest.mark.parametrize("rough", [0.0, 0.02])
def test_errors_outside_of_the_leading_modes_do_not_enter(tmp_path, rough):
    system = ring.linear_system(tmp_path)
    library = ring.library(system)
    nominal = ring.ensemble(system, 6).states
    assert isinstance(nominal, torch.Tensor)
    lawful = system.with_terms([(library[1], -0.05)])
    fields = simulate(lawful, ring.starts(system, 1, 4), ring.TIMES)[0]
    # A wave of the grid, whose decay in a step looks like a derivative of high order.
    wave = torch.cos(torch.pi * torch.arange(32)).double()
    fields = fields + rough * wave
    scales = term_scales(system, library, nominal[0], 0.0)
    steps = SimulatorSteps(system, library, scales)
    forecasts = steps.forecasts(fields, ring.TIMES, BEGINS, [1, 2])
    columns = steps.columns(fields, ring.TIMES, forecasts)
    pod = POD.fit(nominal.flatten(0, 1), 6)
    blocks = field_regression(pod, 6, fields, forecasts, columns, scales)
    found = sparse_fit(blocks, 0.05, 0, np.random.default_rng(0)).coefficients
    assert np.flatnonzero(found).tolist() == [1]
    assert found[1] == pytest.approx(-0.05, rel=0.02)
