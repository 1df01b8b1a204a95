"""Mechanisms with dry friction, backlash, drag and hysteresis.

In each of them the simulator lacks one force.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from itertools import product

import numpy as np

from dashred.evaluation.foreign.cases.case import Array, TrueTerm
from dashred.evaluation.foreign.cases.phases import Exit, Force, Phase

Values = Mapping[str, float]


@dataclass(frozen=True)
class Mechanism:
    """A mechanism.

    Attributes:
        title: of the simulator.
        says: the force that the simulator lacks.
        fields: description by name; the first ones of the states.
        parameters: values about which those of a case are drawn, and which the simulator knows.
        secret: values about which those of the missing force are drawn.
        equations: of the simulator, in the equation language.
        known: the same as a function of the parameters, for all states.
        phases: the missing force by phase, as a function of all values.
        begin: first phase.
        start: initial state, all states.
        duration: of the record.
        terms: the law, if the equation language expresses it, as a function of all values.
        positions: fields that are always measured.
    """

    title: str
    says: str
    fields: Mapping[str, str]
    parameters: Values
    secret: Values
    equations: Mapping[str, str]
    known: Callable[[Values], Force]
    phases: Callable[[Values], Mapping[str, Phase]]
    begin: str
    start: tuple[float, ...]
    duration: float
    positions: tuple[str, ...]
    terms: Callable[[Values], tuple[TrueTerm, ...]] = lambda _: ()


def _side(value: float) -> str:
    return "+" if value > 0 else "-"


def _oscillator(p: Values) -> Force:
    return lambda t, s: np.array([s[1], -p["k"] * s[0] - p["c"] * s[1]])


def _dry_friction(p: Values) -> dict[str, Phase]:
    """Coulomb friction; the slider sticks where the spring is weaker than the friction."""

    def next_phase(_: float, s: Array) -> str:
        return "stick" if abs(p["k"] * s[0]) <= p["mu"] else _side(-s[0])

    def slip(sign: float) -> Phase:
        stop = Exit(lambda t, s: s[1], -int(sign), next_phase)
        return Phase(lambda t, s: np.array([0.0, -sign * p["mu"]]), (stop,))

    hold = Phase(lambda t, s: np.array([-s[1], p["k"] * s[0] + p["c"] * s[1]]))
    return {"+": slip(1.0), "-": slip(-1.0), "stick": hold}


def _belt(p: Values) -> dict[str, Phase]:
    """Friction of a belt of speed V, which falls with the relative speed: stick and slip."""

    def slide(t: float, s: Array) -> Array:
        relative = max(0.0, p["V"] - s[1])
        return np.array([0.0, p["mu"] * (p["low"] + (1 - p["low"]) / (1 + relative / p["vs"]))])

    def hold(t: float, s: Array) -> Array:
        return np.array([p["V"] - s[1], p["k"] * s[0] + p["c"] * s[1]])

    caught = Exit(lambda t, s: s[1] - p["V"], 1, lambda t, s: "stick")
    torn = Exit(lambda t, s: p["k"] * s[0] + p["c"] * p["V"] - p["mu"], 1, lambda t, s: "slip")
    return {"slip": Phase(slide, (caught,)), "stick": Phase(hold, (torn,))}


def _two_masses(p: Values) -> Force:
    def known(t: float, s: Array) -> Array:
        x, y, v, w = s
        coupling = p["k"] * (x - y)
        drive = p["F"] * np.cos(p["w"] * t)
        return np.array([v, w, drive - coupling - p["c"] * v - p["g"] * x, coupling - p["c"] * w])

    return known


def _backlash(p: Values) -> dict[str, Phase]:
    """The coupling has a gap: no force while the distance is smaller."""

    def lacking(force: Callable[[float], float]) -> Force:
        return lambda t, s: np.array([0.0, 0.0, 1.0, -1.0]) * p["k"] * force(s[0] - s[1])

    gap = p["gap"]

    def contact(side: int, direction: int, to: str) -> Exit:
        return Exit(lambda t, s: side * (s[0] - s[1]) - gap, direction, lambda t, s: to)

    return {
        "free": Phase(lacking(lambda d: d), (contact(1, 1, "+"), contact(-1, 1, "-"))),
        "+": Phase(lacking(lambda _: gap), (contact(1, -1, "free"),)),
        "-": Phase(lacking(lambda _: -gap), (contact(-1, -1, "free"),)),
    }


def _pendulum(p: Values) -> Force:
    return lambda t, s: np.array([s[1], -p["g"] * np.sin(s[0]) - p["c"] * s[1]])


def _drag(p: Values) -> dict[str, Phase]:
    def swing(sign: float) -> Phase:
        turn = Exit(lambda t, s: s[1], -int(sign), lambda t, s: "-" if sign > 0 else "+")
        return Phase(lambda t, s: np.array([0.0, -p["b"] * sign * s[1] ** 2]), (turn,))

    return {"+": swing(1.0), "-": swing(-1.0)}


def _driven(p: Values) -> Force:
    def known(t: float, s: Array) -> Array:
        force = p["F"] * np.cos(p["w"] * t) - p["k"] * s[0] - p["c"] * s[1]
        return np.array([s[1], force, 0.0])

    return known


def _hysteresis(p: Values) -> dict[str, Phase]:
    """Bouc and Wen's element: ``z' = v − β|v|z − γ v|z|`` in place of a part of the spring."""

    def phase(sv: int, sz: int) -> Phase:
        def lacking(t: float, s: Array) -> Array:
            slope = 1 - p["beta"] * sv * s[2] - p["gamma"] * sz * s[2]
            return np.array([0.0, p["part"] * p["k"] * (s[0] - s[2]), s[1] * slope])

        turned = Exit(lambda t, s: s[1], -sv, lambda t, s: f"{-sv} {sz}")
        crossed = Exit(lambda t, s: s[2], -sz, lambda t, s: f"{sv} {-sz}")
        return Phase(lacking, (turned, crossed))

    return {f"{sv} {sz}": phase(sv, sz) for sv, sz in product((1, -1), repeat=2)}


MECHANISMS: dict[str, Mechanism] = {
    "dry_friction": Mechanism(
        "Slider on a spring",
        "dry friction, with sticking",
        fields={"x": "position", "v": "velocity"},
        parameters={"k": 6.0, "c": 0.05},
        secret={"mu": 0.3},
        equations={"x": "v", "v": "-k*x - c*v"},
        known=_oscillator,
        phases=_dry_friction,
        begin="-",
        start=(2.4, 0.0),
        duration=24.0,
        positions=("x",),
        terms=lambda p: (TrueTerm("v", "sign(v)", -p["mu"]),),
    ),
    "stick_slip": Mechanism(
        "Mass on a spring",
        "the friction of a belt, which falls with speed: stick and slip",
        fields={"x": "position", "v": "velocity"},
        parameters={"k": 4.0, "c": 0.08},
        secret={"V": 0.8, "mu": 3.0, "low": 0.4, "vs": 0.5},
        equations={"x": "v", "v": "-k*x - c*v"},
        known=_oscillator,
        phases=_belt,
        begin="slip",
        start=(0.4, 0.1),
        duration=30.0,
        positions=("x",),
    ),
    "backlash": Mechanism(
        "Two masses, coupled",
        "a gap in the coupling",
        fields={"x": "drive", "y": "load", "v": "speed of the drive", "w": "speed of the load"},
        parameters={"k": 5.0, "c": 0.25, "g": 1.0, "F": 2.0, "w0": 1.3},
        secret={"gap": 0.35},
        equations={
            "x": "v",
            "y": "w",
            "v": "F*cos(w0*t) - k*(x - y) - c*v - g*x",
            "w": "k*(x - y) - c*w",
        },
        known=lambda p: _two_masses({**p, "w": p["w0"]}),
        phases=_backlash,
        begin="free",
        start=(0.1, 0.0, 0.2, 0.0),
        duration=36.0,
        positions=("x", "y"),
    ),
    "quadratic_drag": Mechanism(
        "Pendulum",
        "drag that grows with the square of the speed",
        fields={"a": "angle", "o": "rate"},
        parameters={"g": 5.0, "c": 0.03},
        secret={"b": 0.12},
        equations={"a": "o", "o": "-g*sin(a) - c*o"},
        known=_pendulum,
        phases=_drag,
        begin="-",
        start=(1.6, 0.0),
        duration=24.0,
        positions=("a",),
        terms=lambda p: (TrueTerm("o", "o*abs(o)", -p["b"]),),
    ),
    "hysteresis": Mechanism(
        "Driven oscillator",
        "a spring with hysteresis (Bouc and Wen)",
        fields={"x": "displacement", "v": "velocity"},
        parameters={"k": 4.0, "c": 0.15, "F": 2.2, "w": 1.5},
        secret={"part": 0.5, "beta": 0.6, "gamma": 0.3},
        equations={"x": "v", "v": "F*cos(w*t) - k*x - c*v"},
        known=_driven,
        phases=_hysteresis,
        begin="1 1",
        start=(0.3, 0.4, 0.2),
        duration=36.0,
        positions=("x",),
    ),
}
