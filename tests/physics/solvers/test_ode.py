"""ODE systems: the pendulum against elliptic functions."""

from __future__ import annotations

import math

import numpy as np
import pytest
import torch
from scipy.special import ellipj, ellipk

from dashred.core.budget import OutOfTimeError
from dashred.core.errors import InputError
from dashred.physics.runs.initial_state_prior import nominal_start
from dashred.physics.solvers.simulate import simulate

AMPLITUDE, RATE = 2.0, 3.0
TIMES = np.array([0.0, 0.1, 0.37, 1.0, 1.01, 2.5, 4.0])


def pendulum(make_system, **integrator):
    settings = ", ".join(f"{key}: {value}" for key, value in integrator.items())
    return make_system(f"""
        fields: {{theta: angle, omega: rate}}
        parameters: {{w: {RATE}}}
        equations: {{theta: omega, omega: -w**2*sin(theta)}}
        start: {{theta: {AMPLITUDE}, omega: 0}}
        integrator: {{{settings}}}
    """)


def exact(times):
    """``θ = 2 asin(k sn(K - ω₀t))`` with ``k = sin(θ₀/2)``, and its derivative."""
    k = math.sin(AMPLITUDE / 2)
    sn, cn, _, _ = ellipj(ellipk(k**2) - RATE * times, k**2)
    return np.stack([2 * np.arcsin(k * sn), -2 * k * RATE * cn], axis=1)


def error(system, times=TIMES):
    path = simulate(system, nominal_start(system), torch.from_numpy(times))
    return float(np.abs(path[0].numpy() - exact(times)).max())


@pytest.mark.parametrize("method", ["dopri5", "dopri8"])
def test_adaptive_methods_reach_their_tolerance_at_irregular_times(make_system, method):
    loose = error(pendulum(make_system, dt=0.1, method=method, rtol=1e-5, atol=1e-5))
    tight = error(pendulum(make_system, dt=0.1, method=method, rtol=1e-9, atol=1e-9))
    assert tight < 1e-7
    assert tight < loose < 1e-2


@pytest.mark.parametrize(("method", "order"), [("rk4", 4), ("midpoint", 2), ("euler", 1)])
def test_fixed_methods_have_their_order(make_system, method, order):
    times = np.array([0.0, 0.3, 0.9])
    errors = [error(pendulum(make_system, dt=dt, method=method), times) for dt in (0.01, 0.005)]
    assert math.log2(errors[0] / errors[1]) == pytest.approx(order, abs=0.15)


def test_fixed_steps_hit_irregular_times(make_system):
    assert error(pendulum(make_system, dt=0.005, method="rk4")) < 1e-6


def test_the_default_method_is_the_one_that_is_compiled(make_system):
    assert pendulum(make_system, dt=0.1).method == "rk4"


def test_an_integrator_of_another_kind_is_refused(make_system):
    with pytest.raises(InputError, match="'etdrk4' does not fit this system"):
        pendulum(make_system, dt=0.1, method="etdrk4")


def test_a_run_with_an_adaptive_method_can_be_ended(make_system):
    system = pendulum(make_system, dt=0.1, method="dopri5")
    told = []

    def progress(done):
        told.append(done)
        if done > 0.3:
            raise OutOfTimeError

    with pytest.raises(OutOfTimeError):
        simulate(system, nominal_start(system), torch.from_numpy(TIMES), progress=progress)
    assert told[0] == 0.0
    assert told[-1] < 0.5
