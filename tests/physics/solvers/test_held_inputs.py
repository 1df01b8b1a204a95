"""A simulator with a held or delayed input, against the analytic solution."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from dashred.core.errors import InputError
from dashred.data.inputs import with_inputs
from dashred.physics.backends.input_signals import InputSignals
from dashred.physics.runs.initial_state_prior import nominal_start
from dashred.physics.solvers.simulate import simulate
from dashred.physics.tangents.cell_tangents import tangent_cells
from dashred.physics.tangents.tangent_linear import tangent_linear

TIMES, POWER = np.arange(5.0), np.array([1.0, 3.0, 0.0, 2.0, 0.0])


def relaxed(make_system, dt, delay=0.0):
    """Simulate ``u' = e - u`` from u = 0, with a held input e."""
    system = make_system(f"""
        fields: {{u: level}}
        parameters: {{}}
        inputs: {{e: {{column: power, hold: true, delay: {delay}}}}}
        equations: {{u: e - u}}
        start: {{u: 0}}
        integrator: {{method: rk4, dt: {dt}}}
    """)
    driven = with_inputs(system, InputSignals(TIMES, {"power": POWER}))
    start, times = torch.zeros(1, 1).double(), torch.from_numpy(TIMES)
    return simulate(driven, start, times)[0, :, 0].numpy()


def exact(delay):
    found = [0.0]
    for before, now in zip([POWER[0], *POWER[:-2]], POWER[:-1], strict=True):
        u = before + (found[-1] - before) * np.exp(-delay)
        found.append(now + (u - now) * np.exp(delay - 1))
    return np.array(found)


@pytest.mark.parametrize("delay", [0.0, 0.25, 0.3])
def test_a_jump_costs_no_order(make_system, delay):
    steps = (0.25, 0.125)
    errors = [np.abs(relaxed(make_system, dt, delay) - exact(delay)).max() for dt in steps]
    assert errors[1] < 1e-5
    assert errors[0] / errors[1] > 12


def test_a_delay_beyond_the_recording_is_refused(make_system):
    with pytest.raises(InputError, match="is 9, but its samples span only 4"):
        relaxed(make_system, 0.125, delay=9.0)


ENDS = {
    "spectral": "insulated",
    "finite volumes": "{left: {slope: 0}, right: {slope: 0}}",
}


def warmed(make_system, ends, dt, delay):
    """Return a system ``T' = lap(T) + e - T`` with a held input e; the same T everywhere."""
    system = make_system(f"""
        axes: {{x: {{length: 1, points: 8, ends: {ends}}}}}
        fields: {{T: temperature}}
        parameters: {{}}
        inputs: {{e: {{column: power, hold: true, delay: {delay}}}}}
        equations: {{T: lap(T) + e - T}}
        start: {{T: 0}}
        integrator: {{dt: {dt}}}
    """)
    return with_inputs(system, InputSignals(TIMES, {"power": POWER}))


@pytest.mark.parametrize("delay", [0.0, 0.3])
@pytest.mark.parametrize("ends", ENDS)
def test_a_field_that_a_held_input_drives_needs_no_short_steps(make_system, ends, delay):
    """The input is constant between its jumps, and the method is exact for a constant."""
    system, times = warmed(make_system, ENDS[ends], 1.0, delay), torch.from_numpy(TIMES)
    start = nominal_start(system)
    found = simulate(system, start, times)[0, :, 0].numpy()
    np.testing.assert_allclose(found, np.outer(exact(delay), np.ones(found.shape[1])), atol=1e-9)
    tangents = tangent_linear if ends == "spectral" else tangent_cells
    along = tangents(system, start[0], torch.zeros_like(start), times, None, ())
    states = np.stack([state[0].numpy() for state, _ in along])
    np.testing.assert_allclose(states, found, atol=1e-12)
