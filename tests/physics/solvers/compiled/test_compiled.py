"""Compiled runs against :func:`simulate`, term by term and row by row."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import pytest
import torch
from torch import Tensor

from dashred.core.threads import use_threads
from dashred.physics.runs.initial_state_prior import nominal_start
from dashred.physics.solvers.compiled.etdrk4 import CompiledETDRK4
from dashred.physics.solvers.compiled.runge_kutta import CompiledRungeKutta
from dashred.physics.solvers.compiled_simulator import (
    CompiledSystem,
    InterpretedSystem,
    compile_system,
)
from dashred.physics.solvers.forcing import Forcing
from dashred.physics.solvers.simulate import simulate
from dashred.physics.system import System, Term
from tests import laws

HEAD = "system:\n  title: declared in a test\n"
REST = "recording: {twin: a, sensors: 4, noise: 0, duration: 4, every: 0.1}\n"
KS = """
  axes: {x: {length: 22, points: 32}}
  fields: {u: height}
  equations: {u: "-u*d(u, x) - d(u, x, 2) - d(u, x, 4)"}
  start: {u: cos(2*pi*x/22) + 0.5*sin(4*pi*x/22)}
  integrator: {dt: 0.05, dealias: DEALIAS}
"""
# As the detonation engine: release, a refilling gate, couplings, coordinates and time.
ENGINE = """
  axes: {x: {length: 2*pi, points: 32}}
  fields: {u: energy, v: progress}
  parameters: {k: 1.1, a: 0.5, nu: 0.1}
  let: {rate: k*exp((u - 1)/a)}
  equations:
    u: -d(u**2/2, x) + rate*(1 - v) - 0.3*u**2 + nu*lap(u) + 0.1*sin(x - t)*u - 0.2*v
    v: 0.2*rate*(1 - v) - v/(1 + exp(3*(u - 0.5))) + nu*lap(v) + 0.05*d(u + v, x)
  start: {u: 0.6 + 0.3*sin(x), v: 0.7 + 0.1*cos(2*x)}
  integrator: {dt: 0.02}
"""
KOLMOGOROV = """
  axes: {x: {length: 2*pi, points: 16}, y: {length: 4*pi, points: 12}}
  fields: {w: vorticity}
  parameters: {nu: 0.1, mu: 0.2}
  equations:
    w: d(inv_lap(w), y)*d(w, x) - d(inv_lap(w), x)*d(w, y) + nu*lap(w) - mu*w + cos(2*x)
  start: {w: cos(x)*sin(y/2) + 0.3*sin(x)}
  integrator: {dt: 0.05, dealias: true}
"""
ODE = """
  fields: {x: place, p: momentum}
  parameters: {k: 2.0}
  equations: {x: p, p: -k*sin(x) - 0.1*p + 0.2*cos(3*t)}
  start: {x: 1, p: 0.3}
  integrator: {method: rk4, dt: 0.05}
"""
Listed = Sequence[tuple[str, str, float]]
EVEN: Listed = [("u", "u**3", -0.05), ("u", "u", -0.1), ("u", "d(u**2, x, 2)", 0.02)]
ODD: Listed = [("u", "d(u, x, 3)", 0.1), ("u", "d(u, x)", 0.3)]
MIXED: Listed = [
    ("u", "u", 0.1),  # linear in its own field: shifts L
    ("v", "d(v, x, 3)", 0.01),
    ("u", "d(v, x, 2)", 0.02),  # linear in the other: a coupling
    ("v", "u", -0.1),
    ("u", "v*d(u, x)", 0.2),
    ("u", "d(u, x)**2", 0.02),
    ("v", "lap(u*v)", 0.02),
    ("v", "sin(x)*cos(t)*u", 0.3),
    ("u", "1", -0.1),
    ("v", "sech(u)*sqrt(v**2 + 1)/(2 + u)", 0.2),
    ("v", "0.7 + u - 0.8*v + 0.3*u**2", 0.2),  # all of it at once, as a parameter's may be
]
PLANE: Listed = [
    ("w", "grad2(w)", 0.05), ("w", "lap(w**3)", 0.01), ("w", "d(w, x)", 0.3),
    ("w", "flux(w**2, y)", 0.1), ("w", "inv_lap(w)", 0.1), ("w", "sin(y/2)*d(w, y)", 0.2),
]  # fmt: skip
SHARP: Listed = [
    ("p", "sign(p)", -0.1), ("p", "abs(p)*p", -0.1), ("p", "sech(x)", 0.3), ("p", "step(x)", 0.2),
    ("x", "tanh(p)**3", 0.1), ("p", "p**4", -0.02), ("p", "log(2 + x**2)/(3 + p)", 0.2),
    ("x", "t", 0.1), ("p", "exp(-x**2)*(2 + sin(t))**0.5", 0.1),
]  # fmt: skip
TIMES = torch.tensor([0.5, 0.6, 0.93, 1.0, 1.7], dtype=torch.float64)


@dataclass(frozen=True)
class Case:
    """A system compiled with terms, and a batch in which every row carries its own."""

    system: System
    terms: tuple[Term, ...]
    run: CompiledSystem
    start: Tensor
    weights: Tensor

    def simulated(self, times: Tensor = TIMES) -> Tensor:
        """Return what the interpreter makes of the batch."""
        return simulate(self.system, self.start, times, Forcing(self.terms, self.weights))


@pytest.fixture(autouse=True)
def _interpreted(monkeypatch: pytest.MonkeyPatch) -> None:
    """Have ``simulate`` interpret however long a run: it is what compiled code is held to."""
    for name in ("ODE_STEPS", "MANY_STEPS"):
        monkeypatch.setattr(f"dashred.physics.solvers.simulate.{name}", math.inf)


@pytest.fixture(scope="module")
def make(tmp_path_factory: pytest.TempPathFactory):
    def declare(text: str, listed: Listed) -> Case:
        system = laws.declared(tmp_path_factory.mktemp("compiled"), HEAD + text[1:] + REST)
        terms = tuple(laws.term(system, e, text).terms[0] for e, text, _ in listed)
        full = torch.tensor([c for _, _, c in listed], dtype=torch.float64)
        generator = torch.Generator().manual_seed(0)
        some = torch.rand((6, len(listed)), generator=generator) < 0.4
        some[0], some[1] = False, True  # one row carries nothing, one everything
        first = nominal_start(system)
        scale = 1 + 0.02 * torch.arange(6).reshape(-1, *(1,) * (first.dim() - 1))
        weights = torch.where(some, full, 0.0)
        return Case(system, terms, compile_system(system, terms), first * scale, weights)

    return declare


@pytest.fixture(scope="module")
def ks(make) -> Case:
    return make(KS.replace("DEALIAS", "true"), [*EVEN, *ODD])


@pytest.fixture(scope="module")
def engine(make) -> Case:
    return make(ENGINE, MIXED)


@pytest.fixture(scope="module")
def ode(make) -> Case:
    return make(ODE, SHARP)


@pytest.mark.parametrize("name", ["ks", "engine", "ode"])
def test_the_trajectories_are_the_simulator_s(name: str, request: pytest.FixtureRequest) -> None:
    case: Case = request.getfixturevalue(name)
    assert isinstance(case.run, CompiledRungeKutta if name == "ode" else CompiledETDRK4)
    found, expected = case.run(case.start, TIMES, case.weights), case.simulated()
    assert found.shape == expected.shape and found.dtype == torch.float64
    torch.testing.assert_close(found, expected, rtol=1e-10, atol=1e-10)
    # Each row's terms make a difference, but for the row that has none.
    bare = simulate(case.system, case.start, TIMES)
    moved = (found - bare).flatten(1).abs().amax(dim=1)
    assert float(moved[0]) < 1e-10 and (moved[1:] > 1e-4).all()


def test_two_axes(make) -> None:
    case = make(KOLMOGOROV, PLANE)
    found = case.run(case.start, TIMES, case.weights)
    torch.testing.assert_close(found, case.simulated(), rtol=1e-10, atol=1e-10)


@pytest.mark.parametrize("name", ["engine", "ode"])
def test_every_term_alone(name: str, request: pytest.FixtureRequest) -> None:
    case: Case = request.getfixturevalue(name)
    count = case.weights.shape[1]
    weights = torch.diag(case.weights[1])
    start = case.start[:1].expand(count, *case.start.shape[1:]).contiguous()
    found = case.run(start, TIMES, weights)
    expected = simulate(case.system, start, TIMES, Forcing(case.terms, weights))
    for j, term in enumerate(case.terms):
        gap = float((found[j] - expected[j]).abs().max())
        assert gap < 1e-10, f"{term.equation}: {term}: {gap:.1e}"


def test_a_row_is_the_same_whatever_stands_beside_it(ks: Case) -> None:
    even = ks.weights.clone()
    even[:, len(EVEN) :] = 0.0
    case = Case(ks.system, ks.terms, ks.run, ks.start, even)
    found = ks.run(ks.start, TIMES, even)
    torch.testing.assert_close(found, case.simulated(), rtol=1e-10, atol=1e-10)
    beside = torch.cat([even, ks.weights[1:2]])
    start = torch.cat([ks.start, ks.start[1:2]])
    torch.testing.assert_close(ks.run(start, TIMES, beside)[:6], found, rtol=1e-10, atol=1e-10)


@pytest.mark.parametrize("name", ["ks", "engine"])
def test_the_wanted_rows_of_a_batch_have_the_bits_of_the_whole(
    name: str, request: pytest.FixtureRequest
) -> None:
    case = request.getfixturevalue(name)
    found = case.run(case.start[2:4], TIMES, case.weights, rows=slice(2, 4))
    torch.testing.assert_close(
        found, case.run(case.start, TIMES, case.weights)[2:4], rtol=0, atol=0, equal_nan=True
    )


def test_a_linear_system_has_nothing_pointwise(make) -> None:
    text = KS.replace("DEALIAS", "false").replace("-u*d(u, x) - d(u, x, 2)", "0.3*d(u, x, 2)")
    case = make(text, ODD)
    found = case.run(case.start, TIMES, case.weights)
    torch.testing.assert_close(found, case.simulated(), rtol=1e-10, atol=1e-10)


def test_threads_change_no_bit_and_progress_ends_at_one(engine: Case) -> None:
    alone = engine.run(engine.start, TIMES, engine.weights)
    told: list[float] = []
    use_threads(2)
    try:
        assert isinstance(engine.run, CompiledETDRK4)
        found = engine.run(engine.start, TIMES, engine.weights, progress=told.append)
    finally:
        use_threads(1)
    assert torch.equal(found, alone)
    assert told == sorted(told) and len(told) == len(engine.start) and told[-1] == 1.0


@pytest.mark.parametrize("threads", [1, 4])
@pytest.mark.parametrize("name", ["engine", "ode"])
def test_a_leap_is_a_run_over_one_span(
    name: str, threads: int, request: pytest.FixtureRequest
) -> None:
    case: Case = request.getfixturevalue(name)
    assert isinstance(case.run, CompiledRungeKutta | CompiledETDRK4)
    use_threads(threads)
    try:
        leap = case.run.leap(case.weights, 0.37)
        found = [leap(case.start.flatten(1).numpy(), begin) for begin in (0.5, 1.1)]
    finally:
        use_threads(1)
    for begin, end in zip((0.5, 1.1), found, strict=True):
        times = torch.tensor([begin, begin + 0.37], dtype=torch.float64)
        expected = case.run(case.start, times, case.weights)[:, -1].flatten(1)
        np.testing.assert_allclose(end, expected.numpy(), rtol=1e-11, atol=1e-12)


def test_dealiasing_is_the_system_s_own(ks: Case, make) -> None:
    plain = make(KS.replace("DEALIAS", "false"), [*EVEN, *ODD])
    found = plain.run(ks.start, TIMES, ks.weights)
    torch.testing.assert_close(found, plain.simulated(), rtol=1e-10, atol=1e-10)
    assert float((found - ks.simulated()).abs().max()) > 1e-7
    modes = torch.fft.rfft(ks.run(ks.start, TIMES, ks.weights)[:, 1:])
    assert float(modes[..., 11:].abs().max()) < 1e-10 < float(modes[..., 10].abs().max())


def test_another_step_needs_no_new_compilation(ks: Case, ode: Case) -> None:
    for case in (ks, ode):
        coarse = case.run.with_step(0.12)
        system = case.system.with_step(0.12)
        expected = simulate(system, case.start, TIMES, Forcing(case.terms, case.weights))
        found = coarse(case.start, TIMES, case.weights)
        torch.testing.assert_close(found, expected, rtol=1e-10, atol=1e-10)
        assert float((found - case.simulated()).abs().max()) > 1e-9
        again = case.run(case.start, TIMES, case.weights)
        torch.testing.assert_close(again, case.simulated(), rtol=1e-10, atol=1e-10)


@pytest.mark.parametrize(("name", "column"), [("ks", 0), ("engine", 0), ("ode", 5)])
def test_a_row_that_blows_up_leaves_the_others_alone(
    name: str, column: int, request: pytest.FixtureRequest
) -> None:
    case: Case = request.getfixturevalue(name)
    weights, times = case.weights.clone(), torch.linspace(0.5, 2.5, 9, dtype=torch.float64)
    weights[2, column] = 400.0
    before = weights.numpy().copy()
    found = case.run(case.start, times, weights)
    assert not torch.isfinite(found[2, -1]).all()
    others = [0, 1, 3, 4, 5]
    alone = case.run(case.start[others], times, weights[others])
    assert torch.isfinite(alone).all()
    torch.testing.assert_close(found[others], alone, rtol=1e-12, atol=1e-12)
    assert np.array_equal(weights.numpy(), before)
    # The kernel's memory holds nothing of a run that was lost.
    again = case.run(case.start, TIMES, case.weights)
    torch.testing.assert_close(again, case.simulated(), rtol=1e-10, atol=1e-10)


def test_an_exact_solution(ode: Case) -> None:
    """A constant force of time alone on x, everything else at rest: ``x = t²/2`` moves p."""
    weights = torch.zeros((1, len(SHARP)), dtype=torch.float64)
    weights[0, [text for _, text, _ in SHARP].index("t")] = 1.0
    start = torch.zeros((1, 2), dtype=torch.float64)
    found, rest = (
        ode.run(start, torch.tensor([0.0, 0.02]).double(), w) for w in (weights, 0 * weights)
    )
    assert float((found - rest)[0, 1, 0]) == pytest.approx(0.02**2 / 2, rel=1e-3)


def test_what_cannot_be_compiled_is_simulated(make) -> None:
    upwind = KS.replace("dealias: DEALIAS", "space: finite-difference").replace(
        "-u*d(u, x) - d(u, x, 2) - d(u, x, 4)", "-flux(u**2/2, x) + 0.5*lap(u)"
    )
    adaptive = ODE.replace("rk4", "dopri5")
    entangled: Listed = [("u", "u*d(u**2, x)", -0.05)]
    cases = [
        make(upwind, [("u", "u", -0.1), ("u", "d(u, x)", 0.2)]),
        make(adaptive, [("p", "p", -0.1)]),
        make(KS.replace("DEALIAS", "true"), entangled),
    ]
    for case in cases:
        assert isinstance(case.run, InterpretedSystem)
        found = case.run(case.start, TIMES, case.weights)
        torch.testing.assert_close(found, case.simulated(), rtol=0, atol=0)
        other = case.run.with_step(0.02)
        assert isinstance(other, InterpretedSystem) and other.system.dt == 0.02
