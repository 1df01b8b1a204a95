"""Random starts: their modes, covariance and size."""

from __future__ import annotations

import math

import numpy as np
import pytest
import torch

from dashred.core.errors import InputError
from dashred.physics.grids.grid import Axis, Grid
from dashred.physics.runs.initial_state_prior import (
    StartPrior,
    fitted_modes,
    gaussian_process_modes,
    nominal_start,
)

LINE = Grid((Axis("x", 2 * math.pi, 64),))
ODD = Grid((Axis("x", 2 * math.pi, 33),))
PLANE = Grid((Axis("x", 6.0, 16), Axis("y", 8.0, 20)))


@pytest.mark.parametrize(
    "grid", [LINE, ODD, PLANE, Grid(())], ids=["line", "odd", "plane", "point"]
)
def test_all_modes_together_have_unit_variance(grid):
    modes = gaussian_process_modes(grid, 0.9, None)
    torch.testing.assert_close((modes**2).sum(0), torch.ones(grid.shape).double())


def test_fewer_modes_are_the_strongest():
    every = gaussian_process_modes(LINE, 0.5, None)
    few = gaussian_process_modes(LINE, 0.5, 10)
    torch.testing.assert_close(few, every[:10])
    power = (every**2).mean(1)
    assert (power.diff() <= 1e-15).all()


def test_the_covariance_is_the_stated_one():
    length = 0.5
    modes = gaussian_process_modes(LINE, length, None)
    covariance = modes.T @ modes[:, 0]
    x = LINE.coordinates["x"]
    wrapped = sum(torch.exp(-((x + n * 2 * math.pi) ** 2) / (2 * length**2)) for n in (-1, 0, 1))
    torch.testing.assert_close(covariance, wrapped, rtol=0, atol=1e-5)


def test_the_covariance_in_the_plane_is_isotropic():
    modes = gaussian_process_modes(PLANE, 0.9, None).flatten(1)
    covariance = (modes.T @ modes[:, 0]).reshape(PLANE.shape)
    x, y = PLANE.coordinates.values()
    near = torch.exp(-(x**2 + y**2) / (2 * 0.9**2))[:6, :8]
    torch.testing.assert_close(covariance[:6, :8], near, rtol=0, atol=1e-3)


def test_modes_are_orthogonal():
    modes = gaussian_process_modes(PLANE, 1.2, 25).flatten(1)
    gram = modes @ modes.T
    torch.testing.assert_close(gram, torch.diag(gram.diag()), rtol=0, atol=1e-12)


def test_spreads_are_percent_of_the_rms_or_absolute(reaction):
    centre = nominal_start(reaction)[0]
    prior = StartPrior(reaction, centre, torch.tensor([4.0, 100.0]).double(), None)
    moved = prior.draw(4000, np.random.default_rng(0)) - centre
    assert moved.shape == (4000, 2, 32)
    std = moved.std(0).mean(-1)
    torch.testing.assert_close(std, torch.tensor([0.4, 0.05]).double(), rtol=0.03, atol=0)
    torch.testing.assert_close(prior.start(torch.zeros(1, prior.size).double())[0], centre)


def test_fields_move_independently(reaction):
    centre = nominal_start(reaction)[0]
    prior = StartPrior(reaction, centre, torch.ones(2).double(), None)
    moved = prior.draw(4000, np.random.default_rng(0)) - centre
    u, v = moved[:, :, 0].T
    assert abs(float((u * v).mean() / (u.std() * v.std()))) < 0.05


def test_an_ode_moves_its_numbers(oscillator):
    centre = nominal_start(oscillator)[0]
    prior = StartPrior(oscillator, centre, torch.tensor([1.0, 2.0]).double(), None)
    assert prior.size == 2
    std = (prior.draw(5000, np.random.default_rng(1)) - centre).std(0)
    torch.testing.assert_close(std, torch.tensor([0.1, 0.1]).double(), rtol=0.05, atol=0)


def test_the_same_seed_draws_the_same_starts(reaction):
    centre = nominal_start(reaction)[0]
    prior = StartPrior(reaction, centre, torch.ones(2).double(), 5)
    draws = [prior.draw(3, np.random.default_rng(seed)) for seed in (7, 7, 8)]
    assert torch.equal(draws[0], draws[1])
    assert not torch.equal(draws[0], draws[2])


SHARED = """
axes: {x: {length: 2*pi, points: 32}}
fields: {u: energy, lam: progress}
parameters: {%s: 9.81}
equations: {u: -u, lam: -lam}
start: {u: 2 + sin(x), lam: 0.5}
spread: {kind: gaussian-process, length: 0.5, modes: 9, apply: {u: u*(1 + 0.1*g), lam: lam + g*u}}
integrator: {dt: 0.1}
"""


def test_one_random_g_moves_several_fields(make_system):
    system = make_system(SHARED % "k")
    centre = nominal_start(system)[0]
    prior = StartPrior(system, centre, torch.ones(2).double(), 9)
    assert prior.size == 9
    u, lam = prior.draw(5, np.random.default_rng(0)).unbind(1)
    g = (u / centre[0] - 1) / 0.1
    assert float(g.std()) > 0.3
    torch.testing.assert_close(lam, 0.5 + g * centre[0])


def test_a_parameter_called_g_is_not_mistaken_for_the_random_g(make_system):
    system = make_system(SHARED % "g")
    with pytest.raises(InputError, match="also has a name 'g'"):
        StartPrior(system, nominal_start(system)[0], torch.ones(2).double(), 9)


def test_without_a_spread_the_start_is_known(burgers):
    centre = nominal_start(burgers)[0]
    prior = StartPrior(burgers, centre, torch.ones(1).double(), None)
    drawn = prior.draw(3, np.random.default_rng(0))
    torch.testing.assert_close(drawn, centre.expand(3, 1, 64))


def test_an_analysis_fits_nearly_all_of_the_variance(reaction):
    centre, rms = nominal_start(reaction)[0], torch.ones(2).double()
    count = fitted_modes(reaction)
    every, few = (StartPrior(reaction, centre, rms, n).basis for n in (None, count))
    assert len(few) == count < len(every)
    variance = every.square().sum(dim=0).mean()
    assert 0 < 1 - float(few.square().sum(dim=0).mean() / variance) < 1e-4


def test_waves_of_the_same_power_are_kept_together(reaction):
    centre, rms = nominal_start(reaction)[0], torch.ones(2).double()
    every = StartPrior(reaction, centre, rms, None).basis
    powers = every.flatten(1).square().mean(dim=1)
    count = fitted_modes(reaction)
    assert powers[count] < 0.99 * powers[count - 1]


def test_a_stated_number_of_modes_is_kept(make_system):
    assert fitted_modes(make_system(SHARED % "k")) == 9
