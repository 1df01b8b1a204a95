"""Candidate terms: enough of them, all different, and none that data cannot tell apart."""

from __future__ import annotations

from collections import Counter

import pytest
import torch

from dashred.core.errors import InputError
from dashred.physics.backends.input_signals import InputSignals
from dashred.physics.system import System
from dashred.physics.terms.collinear_terms import check_collinear, uninformative_terms
from dashred.physics.terms.library import build_library, default_terms, evaluate_terms

AXES = [
    "{}",
    "{x: {length: 3, points: 16}}",
    "{x: {length: 3, points: 8}, y: {length: 2, points: 8}}",
]


def declare(make_system, axes, fields):
    named = ", ".join(f"{f}: a field" for f in fields)
    each = ", ".join(f"{f}: -{f}" for f in fields)
    return make_system(f"""
        axes: {axes}
        fields: {{{named}}}
        parameters: {{k: 3.0}}
        equations: {{{each}}}
        start: {{{", ".join(f"{f}: 1" for f in fields)}}}
        integrator: {{dt: 0.1}}
    """)


def random_states(system, seed=0):
    shape = (6, len(system.fields), *system.grid.shape)
    return torch.randn(shape, generator=torch.Generator().manual_seed(seed)).double()


@pytest.mark.parametrize("fields", ["u", "uv"])
@pytest.mark.parametrize("axes", AXES, ids=["point", "line", "plane"])
def test_the_default_terms_are_distinct(make_system, axes, fields):
    system = declare(make_system, axes, fields)
    library = build_library(system, None)
    counts = Counter(term.equation for term in library)
    assert set(counts) == set(fields)
    # Without a space there are no derivatives.
    assert min(counts.values()) >= (18 if system.axes else 13)
    assert len(set(library)) == len(library)
    assert len(default_terms(system)) == counts["u"]
    check_collinear(system, library, random_states(system), 0.0)
    columns = evaluate_terms(system, library, random_states(system), 0.0)
    assert columns.shape == (len(library), 6, *system.grid.shape)
    assert torch.isfinite(columns).all()


@pytest.mark.parametrize(
    ("first", "second"),
    [("u*v", "2*v*u"), ("lap(u)", "-d(u, x, 2)"), ("1", "3"), ("u*u**2", "u**3/7")],
)
def test_proportional_terms_are_refused_with_both_names(make_system, first, second):
    system = declare(make_system, AXES[1], "uv")
    with pytest.raises(InputError) as caught:
        build_library(system, {"u": ["u", first, second]})
    assert repr(first) in caught.value.what
    assert repr(second) in caught.value.what


def test_the_same_term_may_stand_in_two_equations(make_system):
    system = declare(make_system, AXES[1], "uv")
    assert len(build_library(system, {"u": ["u*v"], "v": ["u*v"]})) == 2


def test_a_term_with_a_typo_is_refused(make_system):
    system = declare(make_system, AXES[1], "uv")
    with pytest.raises(InputError, match="unknown name 'w'"):
        build_library(system, {"u": ["u*w"]})


@pytest.mark.parametrize(
    ("terms", "states", "says"),
    [
        (["u", "v", "d(u**2, x)", "u*d(u, x)"], None, ("'d(u**2, x)'", "'u*d(u, x)'")),
        (["u", "abs(u)"], "positive", ("'u'", "'abs(u)'")),
        (["u", "k*u + t*u", "v"], None, ("'u'", "'k*u + t*u'")),
        (["u", "step(-u)"], "positive", ("'step(-u)'", "vanishes")),
        (["u", "log(-u)"], "positive", ("'log(-u)'", "not finite")),
    ],
)
def test_columns_that_data_cannot_tell_apart_are_refused(make_system, terms, states, says):
    system = declare(make_system, AXES[1], "uv")
    x = system.grid.coordinates["x"]
    wave = torch.sin(2 * torch.pi * x / 3)
    state = torch.stack([wave, wave.roll(3)])[None]
    library = build_library(system, {"u": terms})
    with pytest.raises(InputError) as caught:
        check_collinear(system, library, state + 2 if states else state, 1.0)
    assert all(word in caught.value.what for word in says)


def test_of_terms_that_are_the_same_the_earlier_stays(make_system):
    system = declare(make_system, AXES[1], "uv")
    state = 2 + torch.sin(2 * torch.pi * system.grid.coordinates["x"] / 3).expand(1, 2, -1)
    texts = ["1", "u", "abs(u)", "sign(u)", "u*v", "v*abs(v)", "v**2"]
    library = build_library(system, {"u": texts, "v": ["abs(u)"]})
    same = uninformative_terms(system, library, state, 0.0)
    # u and v have the same values here.
    told = {(term.equation, str(term)): str(other) for term, other in same.items()}
    assert set(told) == {("u", "abs(u)"), ("u", "sign(u)"), ("u", "v*abs(v)"), ("u", "v**2")}
    assert told["u", "abs(u)"] == "u" and told["u", "sign(u)"] == "1"
    assert told["u", "v**2"] == told["u", "v*abs(v)"] == "u*v"


def test_what_vanishes_or_is_not_finite_is_told(make_system):
    system = declare(make_system, AXES[1], "uv")
    library = build_library(system, {"u": ["u", "exp(-u**2)", "exp(u)", "step(-u)", "abs(u)"]})
    state = 1e5 * (2 + torch.rand((3, 2, *system.grid.shape), dtype=torch.float64))
    why = uninformative_terms(system, library, state, 0.0)
    told = {str(term): str(reason) for term, reason in why.items()}
    assert told == {
        "exp(-u**2)": "vanishes",
        "exp(u)": "is not finite",
        "step(-u)": "vanishes",
        "abs(u)": "u",
    }


def test_one_column_in_two_equations_is_not_collinear(make_system):
    system = declare(make_system, AXES[1], "uv")
    library = build_library(system, {"u": ["u*v"], "v": ["u*v"]})
    check_collinear(system, library, random_states(system), 0.0)


def test_columns_are_the_terms_values(make_system):
    system = declare(make_system, AXES[2], "uv")
    states = random_states(system)
    library = build_library(system, {"u": ["1", "k*u*v", "y*t"], "v": ["u**2"]})
    one, product, clock, square = evaluate_terms(system, library, states, 2.0)
    u, v = states.unbind(1)
    torch.testing.assert_close(one, torch.ones_like(u))
    torch.testing.assert_close(product, 3 * u * v)
    torch.testing.assert_close(clock, (2 * system.grid.coordinates["y"]).expand(u.shape))
    torch.testing.assert_close(square, u**2)


@pytest.mark.parametrize("axes", AXES[:2], ids=["point", "line"])
@pytest.mark.parametrize(
    ("described", "tendency", "unit"),
    [
        ("temperature", "-0.1*T", None),
        ("angular velocity (rad/s)", "-T", "rad/s"),
        ("angle of the arm", "-T", None),
        ("phase of the oscillator", "1 - sin(T)", None),
        ("position", "-T", "rad"),
    ],
)
def test_sines_are_candidates_for_angles_only(make_system, axes, described, tendency, unit):
    units = "{}" if unit is None else f"{{T: {unit}}}"
    system = make_system(f"""
        axes: {axes}
        fields: {{T: {described}}}
        units: {units}
        equations: {{T: {tendency}}}
        start: {{T: 1}}
        integrator: {{dt: 0.1}}
    """)
    waves = {text for text in default_terms(system) if "sin(" in text or "cos(" in text}
    assert bool(waves) == (described not in ("temperature", "angular velocity (rad/s)"))
    # Whoever asks for a sine of anything gets it.
    assert [str(term) for term in build_library(system, {"T": ["sin(2*T)"]})] == ["sin(2*T)"]


@pytest.mark.parametrize("m", [1.0, 2.0])
@pytest.mark.parametrize(
    ("force", "opened"), [("-k*sin(q)", {"p"}), ("-k*q - q**3", {"p"}), ("-k*q", {"p"})]
)
def test_an_equation_that_says_what_a_field_is_has_no_terms_whatever_its_parameter(
    make_system, m, force, opened
):
    system = make_system(f"""
        fields: {{q: place (m), p: momentum (kg m/s)}}
        parameters: {{m: {m}, k: 3.0}}
        equations: {{q: p/m, p: "{force}"}}
        start: {{q: 1, p: 0}}
        integrator: {{dt: 0.1}}
    """)
    assert {term.equation for term in build_library(system, None)} == opened
    assert {term.equation for term in build_library(system, {"q": ["q"]})} == {"q"}


@pytest.mark.parametrize(
    ("a", "b", "opened"),
    [
        ("-k*a", "k*a", {"a", "b"}),
        ("-k*a**2", "2*a", {"a", "b"}),
        ("-k*a + 0.1*b", "k*a", {"a"}),
        ("-9.81", "a", {"a"}),
        ("-9.81 - k*a", "a", {"a"}),
    ],
)
def test_what_becomes_something_else_is_no_rate(make_system, a, b, opened):
    """In a chain a → b both equations have terms; in a fall, b is the height and a its rate."""
    system = make_system(f"""
        fields: {{a: substrate, b: product}}
        parameters: {{k: 3.0}}
        equations: {{a: "{a}", b: "{b}"}}
        start: {{a: 1, b: 0}}
        integrator: {{dt: 0.1}}
    """)
    assert {term.equation for term in build_library(system, None)} == opened


def test_equations_that_only_define_fields_all_have_terms(make_system):
    system = make_system("""
        fields: {q: charge (C), p: flux (V s)}
        equations: {q: p, p: 2*q}
        start: {q: 1, p: 0}
        integrator: {dt: 0.1}
    """)
    assert {term.equation for term in build_library(system, None)} == {"q", "p"}


DRIVEN = """
    fields: {q: charge (C), phi: flux linkage (Wb)}
    parameters: {C: 0.5}
    equations: {q: phi, phi: -q/C + V}
    inputs: {V: voltage}
    start: {q: 1, phi: 0}
    integrator: {dt: 0.1}
"""


def test_an_input_is_a_candidate_and_is_told_from_a_constant_by_its_own_clock(make_system):
    times = torch.linspace(0, 3, 6, dtype=torch.float64)
    undriven = make_system(DRIVEN)
    sampled_forcing = InputSignals(times.numpy(), {"V": torch.sin(times).numpy()})
    system = System(undriven.config, undriven.where, sampled_forcing)
    library, states = build_library(system, None), random_states(system)
    assert "V" in {str(term) for term in library if term.equation == "phi"}
    # At the first moment alone, when the drive is 0, nothing could be told of it.
    assert {str(term) for term in uninformative_terms(system, library, states, 0.0)} == {"V"}
    assert not uninformative_terms(system, library, states, times)
    [column] = evaluate_terms(system, build_library(system, {"phi": ["2*V"]}), states, times)
    torch.testing.assert_close(column, torch.sin(times))


def test_each_state_of_a_field_has_its_own_time(make_system):
    system = declare(make_system, AXES[1], "uv")
    states, times = random_states(system), torch.arange(6, dtype=torch.float64)
    library = build_library(system, {"u": ["t*u", "u*v"]})
    clock, product = evaluate_terms(system, library, states, times)
    torch.testing.assert_close(clock, times[:, None] * states[:, 0])
    torch.testing.assert_close(product, states[:, 0] * states[:, 1])


def test_sines_of_angles_alone(make_system):
    system = make_system("""
        fields: {a: angle of the upper arm, h: height, o: its rate, p: phase}
        units: {o: rad}
        equations: {a: o, h: -h, o: -sin(p), p: h}
        start: {a: 0, h: 0, o: 0, p: 0}
        integrator: {dt: 0.1}
    """)
    sines = {text for text in default_terms(system) if text.startswith("sin(")}
    assert {text for text in sines if "2" not in text} == {"sin(a)", "sin(o)", "sin(p)"}


def test_terms_need_no_more_conditions_than_there_are(make_system):
    text = """
axes: {x: {length: 1, points: 10, ends: {left: {c: {value: 1}}, right: {c: outflow}}}}
fields: {c: tracer, w: film}
equations: {c: "-d(c, x)", w: c}
start: {c: 1, w: 0}
integrator: {dt: 0.1}
"""
    system = make_system(text)
    library = {(term.equation, str(term)) for term in build_library(system, None)}
    assert ("c", "d(c, x, 2)") in library
    assert ("c", "d(w, x)") in library
    assert ("c", "d(c, x, 3)") not in library
    assert not {text for equation, text in library if equation == "w" and "d(w" in text}
    with pytest.raises(InputError, match="more conditions at the ends than c has"):
        build_library(system, {"c": ["d(c, x, 4)"]})


def test_a_library_without_terms_is_refused(make_system):
    system = declare(make_system, "{}", "uv")
    assert build_library(system, {"u": [], "v": ["u"]})
    with pytest.raises(InputError, match="the library has no terms") as e:
        build_library(system, {"u": [], "v": []})
    assert "default terms" in str(e.value.hint)


def test_terms_of_two_fields_that_are_equal_in_the_simulation_are_kept(make_system):
    """Two species that only a missing reaction tells apart; abs(u) is u where u is positive."""
    system = declare(make_system, AXES[1], "uv")
    library = build_library(system, {"u": ["u**3", "u*v**2", "u**2*abs(u)"]})
    equal = random_states(system)[:, :1].abs().expand(-1, 2, -1).contiguous()
    left_out = uninformative_terms(system, library, equal, 0.0)
    assert [str(term) for term in left_out] == ["u*v**2", "u**2*abs(u)"]
    moved = equal + 0.1 * random_states(system, 1)
    left_out = uninformative_terms(system, library, equal, 0.0, moved)
    assert [str(term) for term in left_out] == ["u**2*abs(u)"]
    with pytest.raises(InputError, match="proportional"):
        check_collinear(system, library[:2], equal, 0.0)
    check_collinear(system, library[:2], equal, 0.0, moved)
    # Where both fields move in the same way, nothing tells the terms apart.
    left_out = uninformative_terms(system, library, equal, 0.0, 2 * equal)
    assert [str(term) for term in left_out] == ["u*v**2", "u**2*abs(u)"]


def test_terms_of_a_field_that_is_constant_in_the_simulation_are_kept(make_system):
    """A simulator of a reaction that knows no reaction; abs(u) is u where u is positive."""
    system = declare(make_system, AXES[1], "u")
    library = build_library(system, {"u": ["1", "u", "u**2", "abs(u)"]})
    still = torch.full_like(random_states(system), 2.0)
    left_out = uninformative_terms(system, library, still, 0.0)
    assert [str(term) for term in left_out] == ["u", "u**2", "abs(u)"]
    moved = still + 0.1 * random_states(system, 1)
    left_out = uninformative_terms(system, library, still, 0.0, moved)
    assert [str(term) for term in left_out] == ["abs(u)"]
