"""The error of a simulator is measured by doubling its resolution, and refused where it is seen."""

from __future__ import annotations

from pathlib import Path

import pytest
import torch
from torch import Tensor

from dashred.physics.runs.initial_state_prior import nominal_start
from dashred.physics.runs.resolution import (
    accumulated_error,
    check_resolution,
    doubling_error,
    minimum_scale,
    refine,
)
from dashred.physics.solvers.simulate import simulate
from dashred.physics.system import System
from tests import laws

# q turns once in 2π, r four times as fast; of r next to nothing is there.
TWO = """
system:
  title: two oscillators
  fields: {{q: place, v: velocity, r: place, w: velocity}}
  parameters: {{k: 16.0}}
  equations: {{q: v, v: -q, r: w, w: -k*r}}
  start: {{q: 1, v: 0, r: {size}, w: 0}}
  integrator: {{method: rk4, dt: {dt}}}
recording: {{twin: a, sensors: 1, noise: 0, duration: 10, every: 0.5}}
"""
TIMES = torch.linspace(0, 10, 21, dtype=torch.float64)
NO_NOISE = torch.zeros(2, dtype=torch.float64)
LIMIT = 0.01


def places(system: System, states: Tensor) -> Tensor:
    return states[..., [0, 2]]


def two(tmp_path: Path, dt: float, size: float) -> tuple[System, Tensor, Tensor]:
    """Return the system, its start, and the readings of both places."""
    system = laws.declared(tmp_path, TWO.format(dt=dt, size=size))
    start = torch.tensor([[1.0, 0.0, size, 0.0]], dtype=torch.float64)
    return system, start, places(system, simulate(system, start, TIMES))


def error(tmp_path: Path, dt: float) -> float:
    system, start, coarse = two(tmp_path, dt, 1.0)
    return doubling_error(system, start, TIMES, places, coarse, NO_NOISE)[0]


def test_the_error_falls_with_the_order_of_the_scheme(tmp_path: Path) -> None:
    assert error(tmp_path, 0.05) / error(tmp_path, 0.025) == pytest.approx(16, rel=0.1)


def test_the_error_is_nearly_that_to_the_analytic_solution(tmp_path: Path) -> None:
    system, start, coarse = two(tmp_path, 0.05, 1.0)
    found, _ = doubling_error(system, start, TIMES, places, coarse, NO_NOISE)
    exact = torch.stack([torch.cos(TIMES), torch.cos(4 * TIMES)], dim=1)
    off = (coarse[0] - exact).square().mean(dim=0).sqrt() / exact.std(dim=0)
    # Halving the step leaves a sixteenth of it.
    assert found == pytest.approx(float(off.max()) * 15 / 16, rel=0.02)


@pytest.mark.parametrize(("dt", "enough"), [(0.05, 1), (0.125, 2), (0.5, None)])
def test_what_resolution_would_do_is_told(tmp_path: Path, dt: float, enough: int | None) -> None:
    system, start, coarse = two(tmp_path, dt, 1.0)
    found = check_resolution(system, start, TIMES, coarse, places, NO_NOISE, LIMIT)
    assert (found.resolved, found.enough) == (enough == 1, enough)


@pytest.mark.parametrize(("noise", "resolved"), [(1e-3, False), (1e-1, True)])
def test_an_error_that_noise_hides_is_none(tmp_path: Path, noise: float, resolved: bool) -> None:
    system, start, coarse = two(tmp_path, 0.125, 0.1)
    sigma = torch.full((2,), noise, dtype=torch.float64)
    least = minimum_scale(coarse[0], sigma, ["place", "place"], LIMIT)
    found = check_resolution(system, start, TIMES, coarse, places, least, LIMIT)
    assert found.resolved is resolved


def test_noise_that_is_overstated_hides_no_more_than_a_typical_trace_would() -> None:
    generator = torch.Generator().manual_seed(0)
    sizes = torch.tensor([1e-3, 1.0, 2.0, 7.0], dtype=torch.float64)
    traces = sizes * torch.randn((40, 4), generator=generator, dtype=torch.float64)
    reads, std = ["u", "u", "u", "v"], traces.std(dim=0)
    huge = torch.full((4,), 1e6, dtype=torch.float64)
    assert minimum_scale(traces, huge, reads, LIMIT).tolist() == std[[1, 1, 1, 3]].tolist()
    slight = torch.full((4,), 1e-3, dtype=torch.float64)
    assert minimum_scale(traces, slight, reads, LIMIT).tolist() == pytest.approx([1e-2] * 4)


LORENZ = """
system:
  title: Lorenz
  fields: {x: x, y: y, z: z}
  equations: {x: 10*(y - x), y: x*(28 - z) - y, z: x*y - 8/3*z}
  start: {x: 1, y: 1, z: 20}
  integrator: {method: rk4, dt: 0.01}
recording: {twin: a, sensors: 1, noise: 0, duration: 10, every: 0.05}
"""


def test_chaos_is_not_taken_for_a_numerical_error(tmp_path: Path) -> None:
    system = laws.declared(tmp_path, LORENZ)
    start = torch.tensor([[1.0, 1.0, 20.0]], dtype=torch.float64)
    times = torch.linspace(0, 40, 801, dtype=torch.float64)
    path, least = simulate(system, start, times), torch.zeros(3, dtype=torch.float64)

    def states(system: System, states: Tensor) -> Tensor:
        return states

    whole, _ = doubling_error(system, start, times, states, path, least)
    assert whole > 0.5
    assert accumulated_error(system, path[0], times, states, least) < LIMIT
    # Steps that are too long are an error in a segment, too.
    rough = system.with_step(0.05)
    path = simulate(rough, start, times)
    assert accumulated_error(rough, path[0], times, states, least) > LIMIT


@pytest.mark.parametrize("dt", [0.05, 0.125, 0.25])
def test_an_error_that_no_chaos_amplifies_adds_up(tmp_path: Path, dt: float) -> None:
    system, start, coarse = two(tmp_path, dt, 1.0)
    path = simulate(system, start, TIMES)[0]
    whole, _ = doubling_error(system, start, TIMES, places, coarse, NO_NOISE)
    assert accumulated_error(system, path, TIMES, places, NO_NOISE) > 0.9 * whole


# Without viscosity a front steepens: after t = 1 no grid resolves it.
FRONT = """
system:
  title: a front that steepens
  axes: {{x: {{length: 6.283185307179586, points: 64}}}}
  fields: {{u: velocity}}
  equations: {{u: "-u*d(u, x) + {viscosity}*lap(u)"}}
  start: {{u: sin(x)}}
  integrator: {{dt: 0.02}}
recording: {{twin: a, sensors: 4, noise: 0, duration: 4, every: 0.1}}
"""


@pytest.mark.parametrize(("viscosity", "resolved"), [(0.2, True), (0.002, False)])
def test_a_simulation_without_dissipation_is_resolved_in_its_first_part(
    tmp_path: Path, viscosity: float, resolved: bool
) -> None:
    system = laws.declared(tmp_path, FRONT.format(viscosity=viscosity))
    times = torch.linspace(0, 4, 41, dtype=torch.float64)
    [path] = simulate(system, nominal_start(system), times)
    none = torch.zeros(8, dtype=torch.float64)

    def readings(own: System, states: Tensor) -> Tensor:
        return states[:, :, 0, :: own.grid.shape[0] // 8]

    over_all, early = (
        accumulated_error(system, path, times, readings, none, share) for share in (1.0, 0.1)
    )
    assert (over_all <= LIMIT) is resolved
    assert early <= LIMIT


WAVE_PACKET = """
system:
  title: a free wave packet
  axes: {x: {length: 15, points: 64}}
  fields: {p: real part, q: imaginary part}
  equations: {p: "-0.5*lap(q)", q: "0.5*lap(p)"}
  start: {p: exp(-(x - 8)**2), q: 0}
  integrator: {dt: 0.02}
recording: {twin: a, sensors: 4, noise: 0, duration: 4, every: 0.1}
"""


def test_a_step_that_is_unstable_on_the_finer_grid_is_shortened(tmp_path: Path) -> None:
    """The stable step of explicit terms is proportional to the square of the spacing."""
    system = laws.declared(tmp_path, WAVE_PACKET)
    start, times = nominal_start(system), torch.linspace(0, 4, 41, dtype=torch.float64)
    finer, fine_start = refine(system, start)
    assert simulate(finer, fine_start, times).abs().max() > 1e9

    def readings(own: System, states: Tensor) -> Tensor:
        return states[:, :, 0, :: own.grid.shape[0] // 8]

    coarse = readings(system, simulate(system, start, times))
    none = torch.zeros(8, dtype=torch.float64)
    error, _ = doubling_error(system, start, times, readings, coarse, none)
    assert error < LIMIT
