"""The systems of the proof: their possible hidden effects and their recordings."""

from __future__ import annotations

from dataclasses import dataclass, field


@dataclass(frozen=True)
class ProofSystem:
    """A system and the ranges from which its cases are drawn.

    Terms that equal the effect of a parameter are not listed; they are drawn as parameters.

    Attributes:
        name: name of its configuration.
        terms: terms of the library of the analysis, by equation.
        local: pointwise terms that may act in a region or from an onset.
        switched: terms that may be gated by the value of the field ``gated``.
        beyond: forms outside the library, by equation; a is a random number, p a random phase.
        hidden: the equation of a field that no sensor reads; None if there is none.
        parameters: parameters that may be misstated.
        axis: axis of the boxes and its length.
        gated: field that gates a term, and the range of its threshold.
        duration: duration of a recording.
        sensors: range of the number of fit sensors.
        noise: range of the noise, as a share of the std of each trace.
        effect: range of the rms of the hidden effect at the sensors, in units of the noise.
        starts: range of the factor on the spread of a start outside its prior.
        share: range of the size of the hidden effect, as a share of the tendency of its equation
            or of the value of a parameter; None if `effect` determines the size.
        coarse: arguments with which the simulator is not resolved.
        analysis: arguments of every analysis; training is short, because the proof tests laws.
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


FHN = ProofSystem(
    name="fhn",
    # v_x in u's equation and u_x in v's are not drawn: v is not measured, so that another initial v
    # turns one into the other, and no recording separates them.
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
    # A constant in v's equation is not drawn: in a region it acts like a constant in u's equation.
    local={"u": ("1", "u", "v", "u**2", "u*v"), "v": ("u", "v", "u**2")},
    # u stays near two states, in which functions of u gated by u cannot be separated. Neither can
    # gated terms of v's equation, because v is not measured: in practice draws one of ten was
    # decidable.
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
    # a and I are not drawn: another initial v turns one into the other.
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

RDE = ProofSystem(
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
    # s is not drawn: it has the same effect on the front as u_p.
    parameters=("q", "eps", "nu", "u_c"),
    axis=("x", 6.283185307179586),
    # A quarter of lam² lies below u = 0.75 and an eighth above 1.4. A gate far outside this range
    # would be open or closed nearly everywhere.
    gated=("u", 0.75, 1.4),
    duration=10.0,
    sensors=(10, 16),
    # All missing terms move the front in a similar way: smaller effects are undecidable. The front
    # cannot be moved by more than 14 times a noise of 5 %.
    noise=(0.005, 0.05),
    effect=(20.0, 100.0),
    # From a larger distance the front becomes too steep for the time step of the simulator.
    starts=(2.0, 3.0),
    share=None,
    coarse=tuple(f"system.axes.x.points={points}" for points in (48, 64, 72)),
    analysis=("shred.epochs=8", "assimilation.epochs=1", "threads=1"),
)

KS1D = ProofSystem(
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
    # The effect is not used: chaos amplifies every missing term, and another start can cancel it.
    share=(0.01, 0.1),
    coarse=tuple(f"system.axes.x.points={points}" for points in (24, 28, 32)),
    analysis=("shred.epochs=4", "assimilation.epochs=1", "threads=1"),
)

SYSTEMS = {proof_system.name: proof_system for proof_system in (FHN, RDE, KS1D)}
