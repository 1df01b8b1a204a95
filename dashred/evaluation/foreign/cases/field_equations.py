"""The fields whose truths ``py-pde`` computes: equations, domains, and terms to leave out."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field


@dataclass(frozen=True)
class FieldEquation:
    """A system of partial differential equations on a periodic domain.

    Attributes:
        title: name of the equation.
        length: of each axis; all axes have the same.
        points: of the simulator along each axis.
        cells: of the truth along each axis.
        terms: by equation, each in the equation language.
        removable: names of effects that may be left out, each with its terms by equation; without
            them the equation is still well posed.
        start: initial state by field.
        duration: of the recording.
        samples: of the recording.
        sensors: number of sensors.
        step: time step of the simulator.
        parameters: values about which those of a case are drawn.
        axes: names of the axes.
        let: definitions by name, as in a configuration.
        stiff: whether the truth needs an implicit solver.
        library: candidate terms by equation; None for the default.
        pair_interval: time between the two states of a pair, for the methods that are given pairs.
    """

    title: str
    length: float
    points: int
    cells: int
    terms: Mapping[str, tuple[str, ...]]
    removable: Mapping[str, Mapping[str, str]]
    start: Mapping[str, str]
    duration: float
    samples: int
    sensors: int
    step: float
    parameters: Mapping[str, float] = field(default_factory=dict)
    axes: tuple[str, ...] = ("x",)
    let: Mapping[str, str] = field(default_factory=dict)
    stiff: bool = True
    library: Mapping[str, tuple[str, ...]] | None = None
    pair_interval: float | None = None


_PULSES = "exp(6*(cos(2*pi*(x - 4)/12) - 1))"
_WAVES = "cos(2*pi*x/22)*(1 + sin(2*pi*x/22)) + 0.6*sin(6*pi*x/22 + 1)"
_CUBIC_PAIR = {"p": "-q*(p**2 + q**2)", "q": "p*(p**2 + q**2)"}

FIELD_EQUATIONS: dict[str, FieldEquation] = {
    "burgers": FieldEquation(
        "Burgers",
        length=10.0,
        points=96,
        cells=512,
        parameters={"nu": 0.12, "k": 0.15},
        terms={"u": ("-u*d(u, x)", "nu*lap(u)", "-k*u")},
        removable={"steepening": {"u": "-u*d(u, x)"}, "drag": {"u": "-k*u"}},
        start={"u": "1 + 0.6*sin(2*pi*x/10) + 0.3*cos(4*pi*x/10)"},
        duration=5.0,
        samples=101,
        sensors=14,
        step=0.01,
    ),
    "kdv": FieldEquation(
        "Korteweg-de Vries",
        length=20.0,
        points=96,
        cells=1024,
        parameters={"a": 6.0, "b": 1.0},
        terms={"u": ("-a*u*d(u, x)", "-b*d(u, x, 3)")},
        removable={"steepening": {"u": "-a*u*d(u, x)"}},
        start={"u": "0.9*sech(0.67*(x - 6))**2 + 0.4*sech(0.45*(x - 13))**2"},
        duration=3.0,
        samples=101,
        sensors=16,
        step=0.005,
    ),
    "ks": FieldEquation(
        "Kuramoto-Sivashinsky",
        length=22.0,
        points=64,
        cells=512,
        parameters={"a": 1.0, "nu": 1.0},
        terms={"u": ("-u*d(u, x)", "-a*lap(u)", "-nu*lap(lap(u))")},
        removable={"steepening": {"u": "-u*d(u, x)"}, "growth": {"u": "-a*lap(u)"}},
        start={"u": _WAVES},
        duration=24.0,
        samples=121,
        sensors=14,
        step=0.05,
    ),
    "fisher": FieldEquation(
        "Fisher-KPP",
        length=12.0,
        points=96,
        cells=512,
        parameters={"D": 0.1, "r": 0.8},
        terms={"c": ("D*lap(c)", "r*c", "-r*c**2")},
        removable={
            "diffusion": {"c": "D*lap(c)"},
            "growth": {"c": "r*c"},
            "saturation": {"c": "-r*c**2"},
        },
        start={"c": f"0.05 + 0.5*{_PULSES}"},
        duration=6.0,
        samples=101,
        sensors=14,
        step=0.02,
    ),
    "allen_cahn": FieldEquation(
        "Allen-Cahn",
        length=12.0,
        points=96,
        cells=512,
        parameters={"D": 0.08, "r": 1.0},
        terms={"u": ("D*lap(u)", "r*u", "-r*u**3")},
        removable={"diffusion": {"u": "D*lap(u)"}, "saturation": {"u": "-r*u**3"}},
        start={"u": "0.5*cos(2*pi*x/12) + 0.4*sin(6*pi*x/12 + 0.5) + 0.1"},
        duration=4.0,
        samples=101,
        sensors=14,
        step=0.02,
    ),
    "cahn_hilliard": FieldEquation(
        "Cahn-Hilliard",
        length=12.0,
        points=64,
        cells=512,
        parameters={"a": 1.0, "g": 0.15},
        terms={"u": ("a*lap(u**3)", "-a*lap(u)", "-g*lap(lap(u))")},
        removable={"mixing": {"u": "-a*lap(u)"}, "saturation": {"u": "a*lap(u**3)"}},
        start={"u": "0.3*cos(4*pi*x/12) + 0.2*sin(6*pi*x/12 + 0.4) + 0.1*cos(2*pi*x/12)"},
        duration=1.6,
        samples=101,
        sensors=14,
        step=0.005,
        library={
            "u": (
                *("1", "u", "u**2", "u**3", "d(u, x)", "u*d(u, x)", "lap(u)", "lap(u**2)"),
                *("lap(u**3)", "lap(lap(u))", "grad2(u)", "u*lap(u)", "d(u, x, 3)"),
            )
        },
    ),
    "swift_hohenberg": FieldEquation(
        "Swift-Hohenberg",
        length=25.0,
        points=64,
        cells=512,
        parameters={"r": 0.6, "g": 0.9},
        terms={"u": ("(r - 1)*u", "-2*lap(u)", "-lap(lap(u))", "g*u**2", "-u**3")},
        removable={"asymmetry": {"u": "g*u**2"}, "saturation": {"u": "-u**3"}},
        start={"u": "0.6*cos(8*pi*x/25) + 0.3*sin(6*pi*x/25 + 1) + 0.2*cos(2*pi*x/25)"},
        duration=8.0,
        samples=101,
        sensors=16,
        step=0.02,
    ),
    "fitzhugh_nagumo": FieldEquation(
        "FitzHugh-Nagumo",
        length=30.0,
        points=96,
        cells=512,
        parameters={"D": 0.6, "e": 0.15, "a": 0.4, "b": 0.5},
        terms={
            "v": ("D*lap(v)", "v", "-v**3/3", "-w"),
            "w": ("e*v", "e*a", "-e*b*w"),
        },
        removable={
            "diffusion": {"v": "D*lap(v)"},
            "saturation": {"v": "-v**3/3"},
            "recovery": {"v": "-w"},
            "damping": {"w": "-e*b*w"},
        },
        start={
            "v": "-0.8 + 2*exp(8*(cos(2*pi*(x - 8)/30) - 1))",
            "w": "-0.3 + 0.5*exp(8*(cos(2*pi*(x - 5)/30) - 1))",
        },
        duration=12.0,
        samples=121,
        sensors=14,
        step=0.02,
    ),
    "gray_scott": FieldEquation(
        "Gray-Scott",
        length=2.0,
        points=96,
        cells=512,
        parameters={"Du": 1.0e-3, "Dv": 5.0e-4, "F": 0.04, "k": 0.06},
        terms={
            "u": ("Du*lap(u)", "-u*v**2", "F", "-F*u"),
            "v": ("Dv*lap(v)", "u*v**2", "-F*v", "-k*v"),
        },
        removable={
            "consumption": {"u": "-u*v**2"},
            "production": {"v": "u*v**2"},
            "feed": {"u": "F"},
            "decay": {"v": "-k*v"},
        },
        start={
            "u": "1 - 0.5*exp(10*(cos(pi*(x - 0.9)) - 1))",
            "v": "0.4*exp(10*(cos(pi*(x - 0.9)) - 1))",
        },
        duration=50.0,
        samples=101,
        sensors=16,
        step=0.25,
    ),
    "advection_diffusion": FieldEquation(
        "Advection and diffusion",
        length=12.0,
        points=96,
        cells=512,
        parameters={"U": 0.7, "D": 0.1, "k": 0.2},
        terms={"c": ("-U*d(c, x)", "D*lap(c)", "-k*c")},
        removable={
            "advection": {"c": "-U*d(c, x)"},
            "diffusion": {"c": "D*lap(c)"},
            "decay": {"c": "-k*c"},
        },
        start={"c": f"0.1 + 0.6*{_PULSES}"},
        duration=10.0,
        samples=121,
        sensors=14,
        step=0.02,
    ),
    "schroedinger": FieldEquation(
        "nonlinear Schroedinger",
        length=10.0,
        points=96,
        cells=1024,
        parameters={"g": 0.1},
        terms={
            "p": ("-0.5*lap(q)", "-q*(p**2 + q**2)", "-g*p"),
            "q": ("0.5*lap(p)", "p*(p**2 + q**2)", "-g*q"),
        },
        removable={"focusing": _CUBIC_PAIR, "loss": {"p": "-g*p", "q": "-g*q"}},
        start={"p": "1.4*sech(1.2*(x - 5))", "q": "0.4*exp(4*(cos(2*pi*(x - 3)/10) - 1))"},
        duration=2.5,
        samples=101,
        sensors=14,
        step=0.001,
    ),
    "navier_stokes": FieldEquation(
        "Navier-Stokes in two dimensions",
        length=6.283185307179586,
        points=32,
        cells=128,
        axes=("x", "y"),
        parameters={"nu": 0.02, "m": 0.25, "f": 0.8},
        let={"psi": "-inv_lap(w)", "ux": "d(psi, y)", "uy": "-d(psi, x)"},
        terms={"w": ("-ux*d(w, x)", "-uy*d(w, y)", "nu*lap(w)", "-m*w", "f*sin(3*y)")},
        removable={"drag": {"w": "-m*w"}, "viscosity": {"w": "nu*lap(w)"}},
        start={"w": "1.5*(cos(x)*sin(y) + 0.5*sin(2*x - y) + 0.4*cos(x + 2*y))"},
        duration=5.0,
        samples=51,
        sensors=24,
        step=0.02,
        stiff=False,
    ),
    "ks_plane": FieldEquation(
        "Kuramoto-Sivashinsky in two dimensions",
        length=16.0,
        points=32,
        cells=64,
        axes=("x", "y"),
        parameters={"a": 1.0, "nu": 1.0},
        terms={"u": ("-grad2(u)/2", "-a*lap(u)", "-nu*lap(lap(u))")},
        removable={"steepening": {"u": "-grad2(u)/2"}, "growth": {"u": "-a*lap(u)"}},
        start={
            "u": "1.2*cos(2*pi*x/16)*sin(2*pi*y/16) + 0.7*cos(2*pi*(2*x - y)/16)"
            " + 0.5*sin(2*pi*(x + 2*y)/16)"
        },
        duration=8.0,
        samples=41,
        sensors=24,
        step=0.05,
    ),
}
