"""What a term does: the words fit the physics, the sign, and the size."""

from __future__ import annotations

import pytest

from dashred.physics.expressions import algebra
from dashred.physics.system import System
from dashred.physics.terms.library import default_terms
from dashred.reporting.wording.term_description import describe_term
from tests import laws

LINE = "{x: {length: 2*pi, points: 32}}"
PLANE = laws.TEXT.replace(LINE, "{x: {length: 1, points: 8}, y: {length: 1, points: 8}}")


def text_of(system: System, equation: str, text: str, value: float, std: float = 0.0003) -> str:
    expr = system.parse(text, "library", equation=equation)
    inside, rest = algebra.split_coefficient(expr)
    return describe_term(system, equation, rest, inside * value, std).text


@pytest.fixture(scope="module")
def flow(tmp_path_factory: pytest.TempPathFactory) -> System:
    return laws.declared(tmp_path_factory.mktemp("flow"))


@pytest.fixture(scope="module")
def plane(tmp_path_factory: pytest.TempPathFactory) -> System:
    return laws.declared(tmp_path_factory.mktemp("plane"), PLANE)


@pytest.fixture(scope="module")
def pendulum(tmp_path_factory: pytest.TempPathFactory) -> System:
    return laws.declared(tmp_path_factory.mktemp("pendulum"), laws.PENDULUM)


AMOUNT = "(−0.0400 ± 0.0006)"


@pytest.mark.parametrize(
    ("equation", "term", "value", "expected"),
    [
        ("u", "1", -0.04, "constant sink of internal energy, −0.0400 ± 0.0006 per unit time"),
        ("u", "u", -0.04, "linear damping of internal energy, −0.0400 ± 0.0006 per unit time"),
        ("u", "u", 0.04, "linear growth of internal energy, 0.0400 ± 0.0006 per unit time"),
        ("u", "sin(2*t)", -0.04, "periodic forcing of internal energy with a period of 3.14: (−0"),
        ("u", "cos(0.5*t)", 0.04, "periodic forcing of internal energy with a period of 12.6: (0."),
        ("u", "u**2", -0.04, f"quadratic damping of internal energy where u > 0, {AMOUNT}·u²"),
        ("u", "u**3", -0.04, f"cubic damping of internal energy (saturation), {AMOUNT}·u³"),
        ("u", "d(u, x)", -0.04, "forward transport of internal energy in x, with velocity 0.04"),
        ("u", "d(u, x)", 0.04, "backward transport of internal energy in x, with velocity −0.04"),
        ("u", "d(u, x, 2)", 0.04, "diffusion of internal energy, coefficient 0.0400 ± 0.0006"),
        ("u", "lap(u)", -0.04, "anti-diffusion (sharpening) of internal energy, coefficient −0.0"),
        ("u", "d(u, x, 4)", -0.04, "hyperviscosity (damping of the shortest waves) of internal"),
        ("u", "lap(lap(u))", 0.04, "growth of the shortest waves of internal energy"),
        ("u", "d(u, x, 6)", 0.04, "smoothing of order 6 of internal energy"),
        ("u", "d(u, x, 3)", 0.04, "dispersion of internal energy"),
        ("u", "u*d(u, x)", -0.04, "self-advection of internal energy, with velocity (0.0400"),
        ("u", "d(u**2, x)", -0.04, "self-advection of internal energy, with velocity (0.0800"),
        ("u", "lam*d(u, x)", -0.04, "transport of internal energy, with velocity (0.0400 ± 0.0"),
        ("u", "lam*lap(u)", 0.04, "diffusion of internal energy with coefficient (0.0400 ± 0.00"),
        ("u", "d(u, x)**2", 0.04, "growth of internal energy where it is steep"),
        ("lam", "d(u, x)**2", -0.04, "decrease of combustion progress where internal energy is st"),
        (
            "lam",
            "lap(u)",
            0.04,
            "coupling of combustion progress to the diffusion of internal energy",
        ),
        ("u", "lam", -0.04, "linear coupling of combustion progress into internal energy (lowers"),
        (
            "u",
            "lam**2",
            0.04,
            "coupling of combustion progress squared into internal energy (raise",
        ),
        (
            "u",
            "lam*u",
            -0.04,
            "coupling: damping of internal energy in proportion to combustion pr",
        ),
        ("u", "lam*u**2", -0.04, "coupling: quadratic damping of internal energy in proportion to"),
        (
            "u",
            "exp(-u**2)",
            -0.04,
            f"a further change of internal energy by {AMOUNT}·exp(−u²) per unit time",
        ),
        (
            "u",
            "u*sin(x)",
            -0.04,
            f"a further change of internal energy by {AMOUNT}·u·sin(x) per unit time",
        ),
    ],
)
def test_words_follow_from_the_shape_and_the_sign(
    flow: System, equation: str, term: str, value: float, expected: str
) -> None:
    assert text_of(flow, equation, term, value).startswith(expected)


@pytest.mark.parametrize(
    ("equation", "term", "effect"),
    [
        ("u", "sin(2*t)", "periodic forcing of internal energy with a period of 3.14"),
        ("u", "lam*lap(u)", "diffusion of internal energy"),
        ("u", "d(u, x)", "backward transport of internal energy in x"),
        ("u", "d(u, x, 6)", "smoothing of order 6 of internal energy"),
        ("u", "u**3", "cubic growth of internal energy"),
        ("u", "exp(-u**2)", "a further change of internal energy"),
    ],
)
def test_the_effect_of_a_term_has_no_size(
    flow: System, equation: str, term: str, effect: str
) -> None:
    expr = flow.parse(term, "library", equation=equation)
    found = describe_term(flow, equation, expr, 0.04, 0.0003)
    assert found.effect == effect
    assert (
        found.text == f"{effect}{found.separator}{found.size}" and "0.0400 ± 0.0006" in found.size
    )


@pytest.mark.parametrize(
    ("term", "value", "expected"),
    [
        ("omega", -0.1, "viscous damping of angular velocity, −0.1000"),
        ("sign(omega)", -0.1, "dry friction on angular velocity"),
        ("abs(omega)*omega", -0.1, "quadratic drag on angular velocity"),
        ("omega**3", -0.1, "cubic damping of angular velocity"),
        ("sin(theta)", -0.1, "stronger restoring force, as of gravity, on angular velocity"),
        ("theta", -0.1, "linear restoring force, as of a spring, on angular velocity"),
    ],
)
def test_a_velocity_is_known_by_its_equation(
    pendulum: System, term: str, value: float, expected: str
) -> None:
    assert text_of(pendulum, "omega", term, value).startswith(expected)
    assert "friction" not in text_of(pendulum, "theta", "sign(theta)", value)


def test_in_the_plane_an_axis_is_named_and_mixed_derivatives_are_no_diffusion(
    plane: System,
) -> None:
    assert "diffusion of internal energy along y, " in text_of(plane, "u", "d(u, y, 2)", 0.1)
    assert "transport of internal energy along x, " in text_of(plane, "u", "lam*d(u, x)", 0.1)
    assert text_of(plane, "u", "lap(u)", 0.1).startswith(
        "diffusion of internal energy, coefficient"
    )
    assert "diffusion" not in text_of(plane, "u", "d(d(u, x), y)", 0.1)
    assert text_of(plane, "u", "lap(lap(u))", -0.1).startswith("hyperviscosity")


@pytest.mark.parametrize("name", ["flow", "plane", "pendulum"])
def test_every_term_of_every_library_can_be_told_with_its_size(
    name: str, request: pytest.FixtureRequest
) -> None:
    system: System = request.getfixturevalue(name)
    for equation in system.fields:
        told = [
            text_of(system, equation, text, value)
            for text in default_terms(system)
            for value in (0.04, -0.04)
        ]
        assert len(set(told)) == len(told)
        assert all("0.0400 ± 0.0006" in text for text in told)


UNITS = "units: {t: s, theta: rad, omega: rad/s}\n  integrator"
IN_SPACE = "units: {t: s, x: m, u: J}\n  integrator"


@pytest.mark.parametrize(
    ("equation", "term", "expected"),
    [
        ("omega", "omega", "viscous damping of angular velocity, −0.0400 ± 0.0006 per s"),
        (
            "omega",
            "omega**3",
            "cubic damping of angular velocity (saturation), (−0.0400 ± 0.0006 s/rad²)·omega³",
        ),
        (
            "omega",
            "sin(theta)",
            "stronger restoring force, as of gravity, on angular velocity: "
            "(−0.0400 ± 0.0006 rad/s²)·sin(theta)",
        ),
        (
            "omega",
            "theta",
            "linear restoring force, as of a spring, on angular velocity: "
            "(−0.0400 ± 0.0006 1/s²)·theta",
        ),
        ("omega", "1", "constant sink of angular velocity, −0.0400 ± 0.0006 rad/s²"),
        (
            "theta",
            "omega*abs(omega)",
            "a further change of angle by (−0.0400 ± 0.0006 s/rad)·omega·abs(omega)",
        ),
        (
            "omega",
            "sin(2*t)",
            "periodic forcing of angular velocity with a period of 3.14 s: "
            "(−0.0400 ± 0.0006 rad/s²)·sin(2·t)",
        ),
    ],
)
def test_coefficients_of_a_pendulum_have_units(tmp_path, equation, term, expected) -> None:
    system = laws.declared(tmp_path, laws.PENDULUM.replace("integrator", UNITS))
    assert text_of(system, equation, term, -0.04) == expected


@pytest.mark.parametrize(
    ("equation", "term", "expected"),
    [
        ("u", "d(u, x)", "with velocity 0.0400 ± 0.0006 m/s"),
        ("u", "u*d(u, x)", "with velocity (0.0400 ± 0.0006 m/(J·s))·u"),
        ("u", "lap(u)", "coefficient −0.0400 ± 0.0006 m²/s"),
        ("u", "grad2(u)", "(−0.0400 ± 0.0006 m²/(J·s))·d(u, x)²"),
        # No unit of lam is stated: where it cancels it is not needed, and else none is made up.
        ("lam", "lam", "linear damping of combustion progress, −0.0400 ± 0.0006 per s"),
        ("lam", "u", "(−0.0400 ± 0.0006)·u per s"),
        ("u", "u*lam", "(−0.0400 ± 0.0006)·lam·u per s"),
        ("u", "u**2 + u", "(−0.0400 ± 0.0006)·(u + u²) per s"),
    ],
)
def test_units_that_are_not_stated_are_not_made_up(tmp_path, equation, term, expected) -> None:
    system = laws.declared(tmp_path, laws.TEXT.replace("integrator", IN_SPACE))
    assert expected in text_of(system, equation, term, -0.04)
