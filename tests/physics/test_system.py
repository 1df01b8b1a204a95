"""Declared systems: names, lets, parameters, and what they refuse."""

from __future__ import annotations

import pickle

import pytest
import torch

from dashred.core.errors import InputError
from dashred.physics.backends.input_signals import NO_INPUTS
from dashred.physics.expressions.algebra import to_text
from dashred.physics.expressions.linear import split_linear
from dashred.physics.runs.initial_state_prior import nominal_start
from dashred.physics.system import CPU, Term

TEXT = """
axes: {{x: {{length: 2*pi, points: 16}}}}
fields: {{u: height}}
parameters: {{a: 2.0, b: {b}}}
let: {let}
equations: {{u: "{equation}"}}
start: {{u: {start}}}
integrator: {{dt: 0.1}}
"""


@pytest.fixture
def declare(make_system):
    def make(equation="lap(u)", let="{}", start="sin(x)", b=1.0):
        return make_system(TEXT.format(equation=equation, let=let, start=start, b=b))

    return make


def test_lets_and_parameters_are_put_in(declare):
    system = declare("a*slope + d(slope, x)", "{slope: 'b*d(u, x)'}", b=3.0)
    assert to_text(system.equations["u"]) == "d(slope, x) + a*slope"
    assert to_text(system.resolved["u"]) == "3*d(u, x, 2) + 6*d(u, x)"


@pytest.mark.parametrize(
    ("equation", "linear", "rest"),
    [
        ("a*lap(u) - u*d(u, x)", ["2*d(u, x, 2)"], "-u*d(u, x)"),
        ("a*(u - u**3)", ["2*u"], "-2*u**3"),
        ("x*u + t*lap(u)", [], "t*d(u, x, 2) + u*x"),
        ("inv_lap(d(u, x) + u) + 1", ["inv_lap(u + d(u, x))"], "1"),
        ("u**2 + exp(u)", [], "exp(u) + u**2"),
    ],
)
def test_the_linear_part_is_found(declare, equation, linear, rest):
    system = declare(equation)
    terms, left = split_linear(system.resolved["u"], "u")
    assert [to_text(term) for term in terms] == linear
    assert left == system.parse(rest, "system.equations.u")


@pytest.mark.parametrize(
    ("declared", "says"),
    [
        ({"equation": "lap(w)"}, "unknown name 'w'"),
        ({"let": "{p: q, q: u}"}, "let 'p' reads 'q', which is not defined before it"),
        ({"let": "{p: p + 1}"}, "let 'p' reads 'p', which is not defined before it"),
        ({"equation": "u/(b - 1)"}, "is not finite"),
        ({"let": "{p: 1/(b - 1)}"}, "is not finite"),
    ],
)
def test_refusals_of_equations_name_the_line(declare, declared, says):
    with pytest.raises(InputError) as caught:
        declare(**declared)
    assert says in caught.value.what
    assert "declared.yaml:" in str(caught.value.where)


@pytest.mark.parametrize(
    ("start", "says"),
    [
        ("u + 1", "depends on the field 'u'"),
        ("sin(y)", "unknown name 'y'"),
        ("log(x)", "not finite everywhere"),
    ],
)
def test_refusals_of_starts(declare, start, says):
    with pytest.raises(InputError) as caught:
        nominal_start(declare(start=start))
    assert says in caught.value.what


def test_a_spin_up_that_blows_up_is_refused(make_system):
    system = make_system("""
        fields: {u: height}
        parameters: {}
        equations: {u: u**2}
        start: {u: 1}
        spin_up: 6
        integrator: {dt: 0.01, rtol: 1e-5, atol: 1e-5}
    """)
    with pytest.raises(InputError, match="blows up: u is not finite at t = 1"):
        nominal_start(system)


def test_a_spin_up_runs_the_simulator_first(make_system):
    system = make_system("""
        fields: {u: height}
        parameters: {}
        equations: {u: -u}
        start: {u: 1}
        spin_up: 2
        integrator: {dt: 0.01}
    """)
    assert float(nominal_start(system)) == pytest.approx(torch.tensor(-2.0).exp().item(), rel=1e-6)


@pytest.mark.parametrize("batch", [(), (3,), (2, 5)])
def test_expressions_are_evaluated_on_any_batch(reaction, batch):
    x = reaction.grid.coordinates["x"]
    k = 2 * torch.pi / 5
    state = torch.stack([torch.cos(k * x), torch.full_like(x, 0.2)]).expand(*batch, 2, 32)
    cubic = state[..., 0, :] - state[..., 0, :] ** 3 / 3
    torch.testing.assert_close(reaction.evaluate("cubic", state), cubic)
    slope = (-k * torch.sin(k * x)).expand(*batch, 32)
    torch.testing.assert_close(reaction.evaluate("d(u, x)", state), slope)
    clock = (x + 3.0).expand(*batch, 32)
    torch.testing.assert_close(reaction.evaluate("x + t", state, 3.0), clock)
    single = reaction.evaluate("u*v", state.float())
    assert single.dtype == torch.float32
    torch.testing.assert_close(single.double(), 0.2 * state[..., 0, :], rtol=1e-6, atol=1e-7)


def test_expressions_of_an_ode_are_numbers(oscillator):
    state = torch.tensor([[1.0, 2.0], [3.0, 4.0]]).double()
    torch.testing.assert_close(oscillator.evaluate("x*p", state), torch.tensor([2.0, 12]).double())
    assert float(oscillator.evaluate("k", state[0])) == 2.0


def test_the_refined_system_is_finer_in_space_and_time(reaction):
    finer = reaction.refined()
    assert finer.grid.shape == (64,)
    assert finer.grid.axes[0].length == reaction.grid.axes[0].length
    assert finer.dt == reaction.dt / 2
    assert finer.resolved == reaction.resolved


def test_terms_are_added_as_text(declare):
    system = declare("lap(u)")
    added = system.with_terms([(Term("u", system.parse("-2*u**3", "k")), 0.25)])
    assert to_text(added.equations["u"]) == "d(u, x, 2) - 0.5*u**3"
    assert to_text(system.equations["u"]) == "d(u, x, 2)"


def test_a_system_can_be_handed_to_another_process(reaction):
    again = pickle.loads(pickle.dumps(reaction))
    state = nominal_start(reaction)
    torch.testing.assert_close(again.evaluate("cubic", state), reaction.evaluate("cubic", state))


def test_only_spectral_fields_have_a_device(reaction, oscillator):
    cuda = torch.device("cuda")
    system = reaction.on(cuda)
    for same in (
        system,
        system.with_step(0.01),
        system.refined(),
        system.with_input_signals(NO_INPUTS),
    ):
        assert same.device == cuda
    assert reaction.device == system.on(CPU).device == oscillator.on(cuda).device == CPU
