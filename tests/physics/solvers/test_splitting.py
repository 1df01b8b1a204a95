"""A law beside a program: order of the splitting, and exact solutions."""

from __future__ import annotations

import math
from itertools import pairwise

import pytest
import torch

from dashred.physics.forcing_basis import SampledForcing
from dashred.physics.runs.initial_state_prior import nominal_start
from dashred.physics.runs.resolution import simulate_refined
from dashred.physics.solvers.forcing import Forcing
from dashred.physics.solvers.rhs import SpectralTendency
from dashred.physics.solvers.schedule import schedule
from dashred.physics.solvers.simulate import simulate
from dashred.physics.solvers.splitting import split_steps
from dashred.physics.system import System, Term
from dashred.physics.terms.library import resolve

OSCILLATOR = """
    fields: {x: place, v: velocity}
    parameters: {k: 4.0}
    simulator: {function: tests.programs.oscillator}
    start: {x: 1.0, v: 0.5}
    integrator: {dt: 0.1}
"""
HEAT = """
    axes: {x: {length: 2*pi, points: 32}}
    fields: {u: temperature}
    parameters: {kappa: 0.3}
    simulator: {function: tests.programs.heat}
    start: {u: sin(x) + 0.3*cos(3*x)}
    integrator: {dt: 0.1}
"""
RECORDED = "recording.path=recorded.csv"
TRUST = {name: (f"trust=tests.programs.{name}", RECORDED) for name in ("oscillator", "heat")}
TIMES = torch.linspace(0, 4, 9, dtype=torch.float64)


def law(system: System, *parts: tuple[str, str, float]) -> Forcing:
    terms = resolve(system, [Term(e, system.parse(t, "test", equation=e)) for e, t, _ in parts])
    return Forcing(terms, torch.tensor([[c for *_, c in parts]], dtype=torch.float64))


def damped(times: torch.Tensor, c: float) -> torch.Tensor:
    """Return x of ``x'' = -4 x - c x'`` from x = 1, v = 0.5."""
    w = math.sqrt(4 - c**2 / 4)
    b = (0.5 + c / 2) / w
    return torch.exp(-c / 2 * times) * (torch.cos(w * times) + b * torch.sin(w * times))


def test_a_program_alone_is_run_as_it_is(make_system) -> None:
    system = make_system(OSCILLATOR, *TRUST["oscillator"])
    [path] = simulate(system, nominal_start(system), TIMES)
    torch.testing.assert_close(path[:, 0], damped(TIMES, 0.0), rtol=1e-12, atol=1e-12)


def test_a_law_beside_a_program_converges_with_second_order(make_system) -> None:
    system, errors = make_system(OSCILLATOR, *TRUST["oscillator"]), []
    forcing = law(system, ("v", "v", -0.4))
    for dt in (0.1, 0.05, 0.025):
        [path] = simulate(system.with_step(dt), nominal_start(system), TIMES, forcing)
        errors.append(float((path[:, 0] - damped(TIMES, 0.4)).abs().max()))
    orders = [math.log2(a / b) for a, b in pairwise(errors)]
    assert errors[0] < 2e-3
    assert orders == pytest.approx([2.0, 2.0], abs=0.05)


def test_equations_beside_a_program_are_a_law(make_system) -> None:
    system = make_system(OSCILLATOR, *TRUST["oscillator"])
    [expected] = simulate(system, nominal_start(system), TIMES, law(system, ("v", "v", -0.4)))
    told = system.with_terms([(Term("v", system.parse("v", "test")), -0.4)])
    assert told.config.equations == {"x": "0", "v": "(-0.4*v)"}
    [found] = simulate(told, nominal_start(told), TIMES)
    torch.testing.assert_close(found, expected, rtol=1e-12, atol=1e-12)


def test_a_linear_law_of_a_field_is_exact_where_it_commutes(make_system) -> None:
    system = make_system(HEAT, *TRUST["heat"])
    start = nominal_start(system)
    forcing = law(system, ("u", "lap(u)", 0.2), ("u", "u", -0.1))
    [path] = simulate(system, start, TIMES, forcing)
    x = system.grid.coordinates["x"]
    late = math.exp(-0.6 * 4) * torch.sin(x) + 0.3 * math.exp(-4.6 * 4) * torch.cos(3 * x)
    torch.testing.assert_close(path[-1, 0], late, rtol=1e-9, atol=1e-12)


def test_each_trajectory_has_its_own_law_and_forcing(make_system) -> None:
    system = make_system(HEAT, *TRUST["heat"])
    start = nominal_start(system).repeat(2, 1, 1)
    terms = law(system, ("u", "u", 0.0)).terms
    forcing = Forcing(terms, torch.tensor([[0.0], [-0.5]]).double())
    pushed = SampledForcing(TIMES[[0, -1]], torch.ones((2, 2, 1, 32)).double())
    path = simulate(system, start, TIMES, forcing, sampled_forcing=pushed)
    means = path.mean(dim=(2, 3))
    torch.testing.assert_close(means[0], TIMES, rtol=1e-10, atol=1e-10)
    exact = (1 - torch.exp(-0.5 * TIMES)) / 0.5
    torch.testing.assert_close(means[1], exact, rtol=1e-4, atol=1e-6)


def test_a_finer_program_has_the_same_grid_and_half_the_step(make_system) -> None:
    system = make_system(HEAT, *TRUST["heat"])
    finer, path = simulate_refined(system, nominal_start(system), TIMES)
    assert finer.grid.shape == system.grid.shape and finer.dt == system.dt / 2
    torch.testing.assert_close(path, simulate(system, nominal_start(system), TIMES))


def test_fields_that_a_program_does_not_know_have_equations(make_system) -> None:
    text = OSCILLATOR.replace("v: velocity", "v: velocity, z: integral").replace(
        "oscillator}", "oscillator, fields: [x, v]}\n    equations: {z: x}"
    )
    system = make_system(text.replace("v: 0.5", "v: 0.5, z: 0"), *TRUST["oscillator"])
    [path] = simulate(system.with_step(0.005), nominal_start(system), TIMES)
    exact = (torch.sin(2 * TIMES) / 2 + 0.25 * (1 - torch.cos(2 * TIMES)) / 2).double()
    torch.testing.assert_close(path[:, 2], exact, rtol=1e-3, atol=1e-4)


def test_halves_between_which_there_is_no_output_are_one_step() -> None:
    found = list(split_steps(schedule([0.0, 0.4, 0.6], 0.2)))
    assert [step.t for step in found] == pytest.approx([0.0, 0.2, 0.4])
    befores = [(0.0, 0.1), (0.1, 0.2), (0.4, 0.1)]
    assert [step.before for step in found] == [pytest.approx(before) for before in befores]
    afters = [None, pytest.approx((0.3, 0.1)), pytest.approx((0.5, 0.1))]
    assert [step.after for step in found] == afters


def test_a_law_of_fields_converges_with_second_order(make_system) -> None:
    system, ends = make_system(HEAT, *TRUST["heat"]), []
    forcing = law(system, ("u", "u**2", -0.4), ("u", "u*d(u, x)", -0.3), ("u", "lap(u)", 0.1))
    for dt in (0.05, 0.025, 0.0125, 0.00625):
        ends.append(simulate(system.with_step(dt), nominal_start(system), TIMES, forcing)[0, -1])
    changes = [float((a - b).abs().max()) for a, b in pairwise(ends)]
    orders = [math.log2(a / b) for a, b in pairwise(changes)]
    assert orders == pytest.approx([2.0, 2.0], abs=0.15)


def test_a_linear_law_of_fields_takes_no_evaluation(make_system, monkeypatch) -> None:
    system = make_system(HEAT, *TRUST["heat"])
    calls: list[float] = []
    rest = SpectralTendency.__call__

    def counted(self: SpectralTendency, modes: torch.Tensor, t: float) -> torch.Tensor:
        calls.append(t)
        return rest(self, modes, t)

    monkeypatch.setattr(SpectralTendency, "__call__", counted)
    linear = law(system, ("u", "lap(u)", 0.2), ("u", "u**2", 0.0))
    simulate(system, nominal_start(system), TIMES, linear)
    assert not calls
    simulate(system, nominal_start(system), TIMES, law(system, ("u", "u**2", 0.1)))
    # Five steps between two outputs: six of the law, of two evaluations each.
    assert len(calls) == 8 * 6 * 2
