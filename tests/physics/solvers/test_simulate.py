"""Batches, forcing, gradients and blow-ups of simulations."""

from __future__ import annotations

import pytest
import torch

from dashred.core.errors import InputError
from dashred.physics.runs.initial_state_prior import nominal_start
from dashred.physics.solvers import simulate as simulation
from dashred.physics.solvers.forcing import Forcing
from dashred.physics.solvers.rhs import GridTendency
from dashred.physics.solvers.simulate import check_finite, simulate
from dashred.physics.system import Term
from dashred.physics.terms.library import resolve
from tests import laws

SYSTEMS = ["burgers", "reaction", "plane", "oscillator"]
TIMES = torch.tensor([0.5, 0.6, 0.93, 1.0, 1.7]).double()


@pytest.fixture(params=SYSTEMS)
def system(request):
    return request.getfixturevalue(request.param)


def clock(*times):
    return torch.tensor(times, dtype=torch.float64)


def starts(system, batch, seed=0):
    start = nominal_start(system)
    noise = torch.randn((batch, *start.shape[1:]), generator=torch.Generator().manual_seed(seed))
    return start * (1 + 0.1 * noise.double())


def term(system, equation, text):
    key = f"system.equations.{equation}"
    return Term(equation, system.parse(text, key, equation=equation))


def test_a_batch_equals_single_runs(system):
    # As many members as grid points: a coordinate must not be taken for a batch.
    batch = max([2, *system.grid.shape[-1:]])
    start = starts(system, batch)
    together = simulate(system, start, TIMES)
    assert together.shape == (batch, len(TIMES), *start.shape[1:])
    torch.testing.assert_close(together[:, 0], start)
    for i in (0, batch - 1):
        alone = simulate(system, start[i : i + 1], TIMES)[0]
        torch.testing.assert_close(together[i], alone, rtol=1e-7, atol=1e-7)


def test_intermediate_outputs_do_not_change_the_end(burgers):
    start = nominal_start(burgers)
    straight = simulate(burgers, start, clock(0, 1))[0, -1]
    stopping = simulate(burgers, start, clock(0, 0.21, 0.22, 0.71, 1))[0, -1]
    torch.testing.assert_close(straight, stopping, rtol=0, atol=1e-7)


def test_many_different_intervals_keep_few_coefficients(burgers):
    times = torch.cumsum(torch.linspace(0.01, 0.05, 30, dtype=torch.float64), 0)
    path = simulate(burgers, nominal_start(burgers), times)
    straight = simulate(burgers, nominal_start(burgers), times[[0, -1]])
    torch.testing.assert_close(path[:, -1], straight[:, -1], rtol=0, atol=1e-6)


def test_one_output_time_is_the_start(system):
    start = starts(system, 2)
    torch.testing.assert_close(simulate(system, start, clock(3.0))[:, 0], start)


def test_progress_ends_at_one(burgers):
    seen: list[float] = []
    simulate(burgers, nominal_start(burgers), TIMES, progress=seen.append)
    assert seen == [0.0, 0.25, 0.5, 0.75, 1.0]


CASES = [
    ("burgers", "u", "u**2", 0.3),
    ("burgers", "u", "u*d(u, x)", 0.4),
    ("burgers", "u", "d(u, x, 3)", 0.02),
    ("burgers", "u", "u", -0.5),
    ("burgers", "u", "d(u + 0.3*d(u, x), x)", 0.1),
    ("burgers", "u", "1", 0.7),
    ("burgers", "u", "sin(x)*t", 0.7),
    ("burgers", "u", "step(u)", 0.2),
    ("reaction", "u", "v**2", 0.3),
    ("reaction", "v", "lap(v)", 0.05),
    ("reaction", "v", "lap(u)", 0.05),
    ("reaction", "v", "cubic*d(u, x)", 0.1),
    ("plane", "w", "inv_lap(w)", 0.2),
    ("plane", "w", "w*d(w, y)", 0.2),
    ("plane", "w", "cos(x)", 0.2),
    ("oscillator", "p", "x**3", -0.4),
    ("oscillator", "p", "1", 0.3),
    ("oscillator", "x", "t*p", 0.1),
]


@pytest.mark.parametrize(("name", "equation", "text", "coefficient"), CASES)
def test_forcing_by_rows_equals_the_term_in_the_equation(
    request, name, equation, text, coefficient
):
    system = request.getfixturevalue(name)
    added = term(system, equation, text)
    other = term(system, system.fields[0], f"{system.fields[0]}**3")
    half = coefficient / 2
    coefficients = clock(coefficient, 0.0, half, 0.0, coefficient, -0.1, 0.0, 0.0).reshape(4, 2)
    start = starts(system, 4)
    forcing = Forcing(resolve(system, (added, other)), coefficients)
    found = simulate(system, start, TIMES, forcing)
    for i, (a, b) in enumerate(coefficients.tolist()):
        written = system.with_terms([(added, a), (other, b)])
        expected = simulate(written, start[i : i + 1], TIMES)[0]
        torch.testing.assert_close(found[i], expected, rtol=1e-7, atol=1e-7)
    assert not torch.allclose(found[0], simulate(system, start[:1], TIMES)[0], atol=1e-4)


def test_a_stiff_linear_forcing_lies_inside_the_exponential_integrator(burgers):
    """``-lap²`` explicitly would blow up: its symbol times dt is 20000."""
    stiff = term(burgers, "u", "d(u, x, 4)")
    forcing = Forcing((stiff,), clock(-1.0).reshape(1, 1))
    path = simulate(burgers, starts(burgers, 1), clock(0, 1), forcing)
    check_finite(path, clock(0, 1), burgers)


# Some are zero: a gradient is wanted there too, and where no odd derivative remains.
@pytest.mark.parametrize(
    "xi", [(0.1, -0.2, 0.05, 0.0, 0.0, 0.1, 0.0, 0.3), (0.1, 0.0, 0.05, 0.0) * 2]
)
@pytest.mark.parametrize("name", ["burgers", "oscillator"])
def test_simulations_are_differentiable(request, name, xi, make_system):
    if name == "burgers":
        system = make_system("""
            axes: {x: {length: 2*pi, points: 8}}
            fields: {u: velocity}
            parameters: {nu: 0.2}
            equations: {u: "-u*d(u, x) + nu*lap(u)"}
            start: {u: sin(x)}
            integrator: {dt: 0.1}
        """)
        terms = [term(system, "u", text) for text in ("u**2", "d(u, x)", "lap(u)", "u*d(u, x)")]
    else:
        system = request.getfixturevalue(name)
        terms = [term(system, "p", text) for text in ("x**3", "p", "1", "x*p")]
    start = starts(system, 2).requires_grad_()
    xi = clock(*xi).reshape(2, 4).requires_grad_()

    def end(start, xi):
        return simulate(system, start, clock(0.0, 0.1, 0.2), Forcing(tuple(terms), xi))

    assert torch.autograd.gradcheck(end, (start, xi), rtol=1e-4, atol=1e-6)


def test_the_tendency_on_the_grid_is_the_equation(reaction):
    state = starts(reaction, 3)
    found = GridTendency(reaction)(state, 0.4)
    for i, field in enumerate(reaction.fields):
        expected = reaction.evaluate(reaction.config.equations[field], state, 0.4)
        torch.testing.assert_close(found[:, i], expected)


def explosive(make_system, axes, integrator):
    return make_system(f"""
        {axes}
        fields: {{u: calm, v: explosive}}
        parameters: {{}}
        equations: {{u: -u, v: v**2}}
        start: {{u: 1, v: 1}}
        integrator: {{{integrator}}}
    """)


@pytest.mark.parametrize(
    ("axes", "integrator"),
    [
        ("axes: {x: {length: 1, points: 8}}", "dt: 0.01"),
        ("axes: {x: {length: 1, points: 8}}", "dt: 0.01, space: finite-difference"),
        ("axes: {}", "dt: 0.01, method: rk4"),
    ],
)
def test_a_blow_up_is_refused_with_its_time_and_field(make_system, axes, integrator):
    system = explosive(make_system, axes, integrator)
    times = torch.linspace(0, 3, 31, dtype=torch.float64)
    path = simulate(system, nominal_start(system), times)
    with pytest.raises(InputError, match=r"blows up: v is not finite at t = 1\.[0-9]") as caught:
        check_finite(path, times, system)
    assert "declared.yaml:" in str(caught.value.where)


@pytest.mark.slow
def test_an_adaptive_blow_up_is_found_and_leaves_other_members_alone(make_system):
    system = explosive(make_system, "axes: {}", "dt: 0.01, rtol: 1e-6, atol: 1e-6")
    times = torch.linspace(0, 3, 7, dtype=torch.float64)
    start = clock(1.0, 1.0, 1.0, 0.1, 1.0, 0.4).reshape(3, 2)
    forcing = Forcing((term(system, "u", "u"),), clock(0.0, 0.5, 0.0).reshape(3, 1))
    path = simulate(system, start, times, forcing)
    torch.testing.assert_close(path[1, :, 1], 1 / (10 - times), rtol=1e-5, atol=0)
    torch.testing.assert_close(path[1, :, 0], torch.exp(-times / 2), rtol=1e-5, atol=0)
    assert torch.isfinite(path[0, :2]).all()
    assert not torch.isfinite(path[0, 3:, 1]).any()
    assert torch.isfinite(path[2, :5]).all()
    with pytest.raises(InputError, match=r"up: v is not finite at t = 1(\.5)?\n"):
        check_finite(path, times, system)


CELLS = """
system:
  title: cells that follow a signal, the more the further out
  axes: {x: {length: 20, points: 40, ends: fixed}}
  fields: {u: cells, v: signal}
  equations:
    u: 0.5*d(u, x, 2) - 0.1*x*d(u*d(v, x), x)
    v: 0.5*d(v, x, 2) + 0.1*u - 0.05*v
  start: {u: exp(-(x - 7.5)**2), v: exp(-(x - 12.5)**2)}
  integrator: {dt: 0.01}
recording: {twin: a, sensors: 4, noise: 0, duration: 4, every: 0.1}
"""


def test_equations_without_a_semilinear_form_are_not_compiled(tmp_path, monkeypatch):
    """A function of the place in front of a flux, as a window is, has no such form."""
    declared = laws.declared(tmp_path, CELLS)
    start, times = nominal_start(declared), clock(0.0, 0.5, 1.0)
    interpreted = simulate(declared, start, times)
    monkeypatch.setattr(simulation, "_should_compile", lambda *_: True)
    assert torch.equal(simulate(declared, start, times), interpreted)
    assert interpreted.isfinite().all()
