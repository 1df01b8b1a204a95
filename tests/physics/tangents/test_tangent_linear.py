"""Tangents against central differences of the simulator itself."""

from __future__ import annotations

import pytest
import torch

from dashred.core.threads import use_threads
from dashred.physics.parameter_sensitivity import parameter_tendency
from dashred.physics.runs.initial_state_prior import nominal_start
from dashred.physics.solvers.forcing import Forcing
from dashred.physics.solvers.simulate import simulate
from dashred.physics.system import Term
from dashred.physics.tangents.sources import Sources
from dashred.physics.tangents.spectral_columns.threads import columns_together
from dashred.physics.tangents.tangent_linear import has_spectral_tangents, tangent_linear
from dashred.physics.terms.library import resolve

TIMES = torch.tensor([0.5, 0.6, 0.93, 1.0, 1.7]).double()

ENGINE = """
    axes: {x: {length: 2*pi, points: 32}}
    fields: {u: energy, v: progress}
    parameters: {k: 1.1, a: 0.5, nu: 0.1}
    let: {rate: k*exp((u - 1)/a)}
    equations:
      u: -d(u**2/2, x) + rate*(1 - v) - 0.3*u**2 + nu*lap(u) + 0.1*sin(x - t)*u
      v: 0.2*rate*(1 - v) - v/(1 + exp(3*(u - 0.5))) + nu*lap(v) + 0.05*d(u + v, x)
    start: {u: 0.6 + 0.3*sin(x), v: 0.7 + 0.1*cos(2*x)}
    integrator: {dt: 0.02}
"""
KS = """
    axes: {x: {length: 22, points: 32}}
    fields: {u: height}
    equations: {u: "-u*d(u, x) - d(u, x, 2) - d(u, x, 4)"}
    start: {u: cos(2*pi*x/22) + 0.5*sin(4*pi*x/22)}
    integrator: {dt: 0.05, dealias: true}
"""
KOLMOGOROV = """
    axes: {x: {length: 2*pi, points: 16}, y: {length: 4*pi, points: 12}}
    fields: {w: vorticity}
    parameters: {nu: 0.1, mu: 0.2}
    equations:
      w: d(inv_lap(w), y)*d(w, x) - d(inv_lap(w), x)*d(w, y) + nu*lap(w) - mu*w + cos(2*x)
    start: {w: cos(x)*sin(y/2) + 0.3*sin(x)}
    integrator: {dt: 0.05}
"""
FORCED = {
    "engine": [("u", "u", 0.1), ("u", "d(v, x, 2)", 0.01), ("u", "v*d(u, x)", 0.2),
               ("u", "d(u, x)**2", 0.02), ("v", "d(v, x, 3)", 0.01), ("v", "u*v**2", -0.1)],
    "ks": [("u", "u**3", -0.02), ("u", "d(u, x, 3)", 0.1), ("u", "d(u**2, x, 2)", 0.02)],
    "kolmogorov": [("w", "grad2(w)", 0.05), ("w", "lap(w**3)", 0.01), ("w", "d(w, x)", 0.3),
                   ("w", "flux(w**2, y)", 0.1), ("w", "inv_lap(w)", 0.1)],
}  # fmt: skip
DRIVING = {
    "engine": [[("u", "u*v")], [("v", "d(u, x)*v")], [("u", "1"), ("v", "u**2")],
               [("u", "d(v, x)")], [("u", "v**2"), ("u", "d(u, x, 2)"), ("v", "d(v, x)")]],
    "ks": [[("u", "u**2")], [("u", "sin(u)*d(u, x)")], [("u", "d(u, x, 4)")],
           [("u", "d(u**2, x, 2)")], [("u", "d(u, x)**2*cos(x - t)")]],
    "kolmogorov": [[("w", "w**2")], [("w", "w*lap(w**2)")], [("w", "lap(lap(w))")]],
}  # fmt: skip


def terms(system, listed):
    parsed = [Term(e, system.parse(text, "test", equation=e)) for e, text in listed]
    return resolve(system, parsed)


def directions(system, count=3):
    generator = torch.Generator().manual_seed(0)
    noise = torch.randn((count, len(system.fields), *system.grid.shape), generator=generator)
    modes = torch.fft.rfftn(noise.double(), dim=system.grid.dims)
    for k in system.grid.wavenumbers:
        modes = modes * torch.exp(-(k**2) / 8)
    return torch.fft.irfftn(modes, s=system.grid.shape, dim=system.grid.dims)


@pytest.fixture(params=["engine", "ks", "kolmogorov"])
def case(request, make_system):
    system = make_system({"engine": ENGINE, "ks": KS, "kolmogorov": KOLMOGOROV}[request.param])
    listed = FORCED[request.param]
    coefficients = torch.tensor([[c for _, _, c in listed]], dtype=torch.float64)
    forcing = Forcing(terms(system, [(e, text) for e, text, _ in listed]), coefficients)
    return system, forcing, [terms(system, several) for several in DRIVING[request.param]]


def jacobian(system, forcing, sources, dtype=torch.float64, times=TIMES):
    start = nominal_start(system)[0]
    found = tangent_linear(system, start, directions(system), times, forcing, sources, dtype)
    states, tangents = zip(*found, strict=True)
    return torch.stack(states), torch.stack(tangents)


def central(system, forcing, change, h):
    """Differentiate ``simulate`` along ``change(step) → (start, forcing)``."""
    ahead, behind = (simulate(system, a, TIMES, f)[0] for a, f in (change(h), change(-h)))
    return (ahead - behind) / (2 * h)


def widened(forcing, more, step):
    column = torch.full((1, len(more)), step, dtype=torch.float64)
    return Forcing(forcing.terms + more, torch.cat((forcing.coefficients, column), dim=1))


def relative(found, expected):
    return float((found - expected).norm() / expected.norm())


def test_tangents_are_the_derivative_of_the_simulator(case):
    system, forcing, sources = case
    start = nominal_start(system)
    states, tangents = jacobian(system, forcing, sources)
    torch.testing.assert_close(states, simulate(system, start, TIMES, forcing)[0])
    assert tangents.shape[:2] == (len(TIMES), 3 + len(sources))
    for i, direction in enumerate(directions(system)):
        expected = central(system, forcing, lambda h, d=direction: (start + h * d, forcing), 1e-5)
        assert relative(tangents[:, i], expected) < 1e-7
    for k, more in enumerate(sources, 3):
        # Shorter, for a fourth derivative makes the difference's own error large.
        expected = central(system, forcing, lambda h, m=more: (start, widened(forcing, m, h)), 1e-6)
        assert relative(tangents[:, k], expected) < 1e-7


@pytest.mark.parametrize("parameter", ["k", "a", "nu"])
def test_parameters(make_system, parameter):
    system = make_system(ENGINE)
    slopes = parameter_tendency(system, parameter)
    source = tuple(Term(equation, slope) for equation, slope in slopes.items())
    _, tangents = jacobian(system, None, [source])
    value, h = system.config.parameters[parameter], 1e-5
    words = (f"system.parameters.{parameter}={value + step!r}" for step in (h, -h))
    changed = (make_system(ENGINE, word) for word in words)
    ahead, behind = (simulate(s, nominal_start(s), TIMES)[0] for s in changed)
    assert relative(tangents[:, 3], (ahead - behind) / (2 * h)) < 1e-7


def test_single_precision_is_close(case):
    system, forcing, sources = case
    states, exact = jacobian(system, forcing, sources)
    same, found = jacobian(system, forcing, sources, torch.float32)
    assert found.dtype == torch.float32
    torch.testing.assert_close(same, states, rtol=0, atol=0)
    for column in range(found.shape[1]):
        assert relative(found[:, column].double(), exact[:, column]) < 1e-4


def test_single_precision_is_close_for_columns_of_any_size(case):
    """Columns are integrated in pairs: a large one must not blur a small one."""
    system, forcing, sources = case
    sizes = torch.tensor([1e-6, 1.0, 1e6], dtype=torch.float64)
    moved = directions(system) * sizes.reshape(-1, *(1,) * (directions(system).dim() - 1))
    start, found = nominal_start(system)[0], {}
    for dtype in (torch.float32, torch.float64):
        columns = tangent_linear(system, start, moved, TIMES, forcing, sources, dtype)
        found[dtype] = torch.stack([each for _, each in columns]).double()
    for column in range(found[torch.float32].shape[1]):
        rough, exact = (found[dtype][:, column] for dtype in (torch.float32, torch.float64))
        assert relative(rough, exact) < 1e-4


@pytest.mark.parametrize("pairs", [1, 2])
def test_blocks_of_steps_and_groups_of_columns_change_nothing(case, monkeypatch, pairs):
    """Also where the last group is completed by pairs of zeros."""
    system, forcing, sources = case
    states, whole = jacobian(system, forcing, sources)
    values = pairs * nominal_start(system).numel()
    monkeypatch.setattr("dashred.physics.tangents.tangent_linear.POINTS_AT_ONCE", 1)
    monkeypatch.setattr("dashred.physics.tangents.spectral_columns.threads.GROUP_POINTS", values)
    assert columns_together(whole.shape[1], values // pairs) == 2 * pairs
    same, pieces = jacobian(system, forcing, sources)
    torch.testing.assert_close(same, states, rtol=1e-10, atol=1e-10)
    torch.testing.assert_close(pieces, whole, rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize("threads", [2, 3])
def test_threads_change_no_bit(case, monkeypatch, threads):
    monkeypatch.setattr("dashred.physics.tangents.spectral_columns.threads.GROUP_POINTS", 1)
    monkeypatch.setattr("dashred.physics.tangents.spectral_columns.threads.SHARED_POINTS", 1)
    expected = jacobian(*case)
    use_threads(threads)
    try:
        found = jacobian(*case)
    finally:
        use_threads(1)
    assert all(map(torch.equal, found, expected))


@pytest.mark.parametrize("chosen", [range(0, 2), range(2, 5), range(4, 5)])
def test_chosen_columns_have_the_same_bits_and_only_their_sources_are_evaluated(
    case, monkeypatch, chosen
):
    system, forcing, sources = case
    monkeypatch.setattr("dashred.physics.tangents.spectral_columns.threads.GROUP_POINTS", 1)
    _, whole = jacobian(system, forcing, sources)
    made: list[Sources] = []

    def kept(*args):
        made.append(Sources(*args))
        return made[-1]

    monkeypatch.setattr("dashred.physics.tangents.tangent_linear.Sources", kept)
    start = nominal_start(system)[0]
    found = tangent_linear(
        system, start, directions(system), TIMES, forcing, sources, torch.float64, chosen=chosen
    )
    tangents = torch.stack([columns for _, columns in found])
    assert torch.equal(tangents, whole[:, chosen.start : chosen.stop])
    [evaluated] = made
    pairs = range(chosen.start // 2 * 2, chosen.stop + chosen.stop % 2)
    assert {column for _, column, _ in (*evaluated.drives, *evaluated.shifts)} <= set(pairs)


def test_the_first_output_is_the_start(case):
    system, forcing, sources = case
    [(state, tangents)] = tangent_linear(
        system, nominal_start(system)[0], directions(system), TIMES[:1], forcing, sources
    )
    torch.testing.assert_close(state, nominal_start(system)[0])
    torch.testing.assert_close(tangents[:3], directions(system))
    assert not tangents[3:].any()


def test_without_columns_the_states_are_left(case):
    system, forcing, sources = case
    start = nominal_start(system)[0]
    expected, _ = jacobian(system, forcing, sources)
    found = list(tangent_linear(system, start, start[None][:0], TIMES, forcing, []))
    torch.testing.assert_close(torch.stack([state for state, _ in found]), expected)
    assert all(tangents.shape == (0, *start.shape) for _, tangents in found)


def test_directions_and_sources_do_not_need_each_other(case):
    system, forcing, sources = case
    start = nominal_start(system)[0]
    _, both = jacobian(system, forcing, sources)
    for moved, driven, columns in (
        (directions(system), [], slice(0, 3)),
        (directions(system)[:0], sources, slice(3, None)),
    ):
        found = list(tangent_linear(system, start, moved, TIMES, forcing, driven))
        torch.testing.assert_close(
            torch.stack([tangents for _, tangents in found]), both[:, columns]
        )


def test_a_linear_equation_has_no_pointwise_part(make_system):
    system = make_system("""
        axes: {x: {length: 2*pi, points: 16}}
        fields: {u: height, v: speed}
        equations: {u: v, v: "d(u, x, 2)"}
        start: {u: sin(x), v: 0}
        integrator: {dt: 0.05}
    """)
    _, tangents = jacobian(system, None, [])
    start = nominal_start(system)
    for i, direction in enumerate(directions(system)):
        moved = simulate(system, start + direction, TIMES)[0]
        expected = moved - simulate(system, start, TIMES)[0]
        torch.testing.assert_close(tangents[:, i], expected, rtol=1e-9, atol=1e-9)


def test_supports(case, make_system, oscillator):
    system, forcing, _ = case
    assert has_spectral_tangents(system, forcing.terms)
    field = system.fields[0]
    assert not has_spectral_tangents(system, terms(system, [(field, f"{field}*d({field}**2, x)")]))
    assert not has_spectral_tangents(oscillator, [])
    upwind = "axes: {x: {length: 1, points: 16}}\nfields: {u: speed}\nstart: {u: 1}\n"
    upwind += "equations: {u: '-flux(u**2/2, x)'}\n"
    upwind += "integrator: {dt: 0.01, space: finite-difference}"
    assert not has_spectral_tangents(make_system(upwind), [])
