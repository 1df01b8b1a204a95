"""The systems of the proof: what may be hidden in each, and how its recordings are made."""

from __future__ import annotations

from dataclasses import dataclass, field


@dataclass(frozen=True)
class Proved:
    """One system, and the ranges from which its cases are drawn.

    Terms that are the effect of one parameter are left to the parameters.

    Attributes:
        name: of its configuration.
        terms: of the analysis' library, by equation.
        local: those of them, pointwise, that may act within a region, or from an onset on.
        switched: those that may act in some states of ``gated`` only.
        beyond: forms that the analysis' library does not have, by equation; a is a number that is
            drawn, p a phase.
        hidden: the equation of a field that no sensor reads; None if there is none.
        parameters: those that may be mis-stated.
        axis: along which boxes lie, with its length.
        gated: the field whose value may switch a term, with thresholds from and to.
        duration: of a recording.
        sensors: fewest and most fit sensors.
        noise: least and largest, as a share of each trace's std.
        effect: least and largest rms of what is hidden over the sensors, in units of the noise.
        starts: least and largest factor on its spread of a start that lies outside of its prior.
        share: least and largest size of what is hidden, as a share of its equation's tendency, or
            of a parameter's value; None where the effect decides that.
        coarse: words that make the simulator too coarse for its own equations.
        analysis: words of every analysis: the networks are short, since laws are judged here.
    """

    name: str
    terms: dict[str, tuple[str, ...]]
    local: dict[str, tuple[str, ...]]
    switched: dict[str, tuple[str, ...]]
    beyond: dict[str, tuple[str, ...]]
    hidden: str | None
    parameters: tuple[str, ...]
    axis: tuple[str, float]
    gated: tuple[str, float, float]
    duration: float
    sensors: tuple[int, int]
    noise: tuple[float, float]
    effect: tuple[float, float]
    starts: tuple[float, float]
    share: tuple[float, float] | None
    coarse: tuple[str, ...]
    analysis: tuple[str, ...] = field(default=("assimilation.epochs=1", "threads=1"))


FHN = Proved(
    name="fhn",
    # Of what the library has, v_x in u's equation and u_x in v's are not drawn: while v is not
    # measured, a start with another v makes either of the other, and no recording tells them apart.
    terms={
        "u": (
            *("u", "v", "u**2", "u*v", "v**2", "u**3", "u**2*v", "u*v**2", "v**3"),
            *("u*d(u, x)", "v*d(u, x)"),
        ),
        "v": (
            *("u", "u**2", "u*v", "v**2", "u**3", "u**2*v", "u*v**2", "v**3"),
            *("d(v, x)", "u*d(v, x)", "v*d(v, x)"),
        ),
    },
    # Nor is a constant in v's equation: in a region it does what another does in u's.
    local={"u": ("1", "u", "v", "u**2", "u*v"), "v": ("u", "v", "u**2")},
    # u dwells in two states: of its functions, switched by itself, none is told from another there.
    # Nor are those of v's equation, while v is not measured: of ten that practice draws hid there,
    # one could be decided.
    switched={"u": ("v", "u*v")},
    beyond={
        "u": (
            *("u**4", "u**5", "sin({a}*u)", "tanh({a}*u)", "exp(-{a}*u**2)", "abs(u)*u"),
            *("1/(1 + {a}*u**2)", "cos(2*pi*x/20 + {p})", "u*sin(2*pi*x/20 + {p})"),
            *("sin({a}*t)", "u*sin(t/{a})", "sqrt(1 + {a}*u**2)"),
        ),
        "v": (
            *("u**4", "sin({a}*u)", "tanh({a}*u)", "exp(-{a}*u**2)", "1/(1 + {a}*u**2)"),
            *("cos(2*pi*x/20 + {p})", "sin({a}*t)"),
        ),
    },
    hidden="v",
    # Nor are a and I, which another v at the start turns into each other.
    parameters=("c", "D", "eps", "b"),
    axis=("x", 20.0),
    gated=("u", -0.8, 1.0),
    duration=30.0,
    sensors=(8, 16),
    noise=(0.005, 0.1),
    effect=(4.0, 40.0),
    starts=(3.0, 6.0),
    share=None,
    coarse=tuple(f"system.axes.x.points={points}" for points in (14, 16, 18, 20, 22)),
    analysis=("shred.epochs=4", "assimilation.epochs=1", "threads=1"),
)

RDE = Proved(
    name="rde",
    terms={
        "u": ("u", "u**3", "lam", "lam*u", "lam**2", "lam*u**2"),
        "lam": ("1", "lam", "lam**2", "u", "lam*u"),
    },
    local={"u": ("1", "u", "lam"), "lam": ("1", "lam")},
    switched={"u": ("lam", "lam*u"), "lam": ("lam", "lam*u")},
    beyond={
        "u": ("tanh({a}*u)", "1/(1 + {a}*u**2)", "cos(x + {p})", "sin({a}*t)", "u*sin(x + {p})"),
        "lam": ("exp(-{a}*u)", "cos(x + {p})", "lam*sin({a}*t)"),
    },
    hidden="lam",
    # s is not drawn: it refills as u_p does, and no front tells them apart.
    parameters=("q", "eps", "nu", "u_c"),
    axis=("x", 6.283185307179586),
    # Of lam² a quarter lies below u = 0.75, and an eighth above 1.4: a gate far beyond is open, or
    # shut, nearly throughout, and is none.
    gated=("u", 0.75, 1.4),
    duration=10.0,
    sensors=(10, 16),
    # Whatever is missing moves the front, and each in much the same way: less is undecidable. The
    # front can be moved by no more than 14 times a noise of 5 %.
    noise=(0.005, 0.05),
    effect=(20.0, 100.0),
    # From farther off the front rises so high that the simulator's step does not resolve it.
    starts=(2.0, 3.0),
    share=None,
    coarse=tuple(f"system.axes.x.points={points}" for points in (48, 64, 72)),
    analysis=("shred.epochs=8", "assimilation.epochs=1", "threads=1"),
)

KS1D = Proved(
    name="ks1d",
    terms={
        "u": (
            *("u", "u**2", "u**3", "d(u, x)", "d(u, x, 3)", "d(u, x)**2", "u**2*d(u, x)"),
            *("u*d(u, x, 2)", "d(u, x, 2)", "u*d(u, x)"),
        )
    },
    local={"u": ("1", "u", "u**2", "u**3")},
    switched={"u": ("1", "u")},
    beyond={
        "u": (
            *("sin({a}*u)", "abs(u)*u", "tanh({a}*u)"),
            *("cos(2*pi*x/38 + {p})", "u*cos(2*pi*x/38 + {p})"),
        )
    },
    hidden=None,
    parameters=("nu",),
    axis=("x", 38.0),
    gated=("u", -1.0, 1.0),
    duration=60.0,
    sensors=(10, 14),
    noise=(0.005, 0.1),
    effect=(3.0, 30.0),
    starts=(3.0, 6.0),
    # Chaos makes a large effect of whatever is missing, and another start takes it away again.
    share=(0.01, 0.1),
    coarse=tuple(f"system.axes.x.points={points}" for points in (24, 28, 32)),
    analysis=("shred.epochs=4", "assimilation.epochs=1", "threads=1"),
)

SYSTEMS = {proved.name: proved for proved in (FHN, RDE, KS1D)}
