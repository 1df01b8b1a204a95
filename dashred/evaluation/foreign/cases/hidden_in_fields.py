"""What is hidden in a field: an effect left out, a localised source, a term in a region."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from dashred.evaluation.foreign.cases.case import Array, TrueTerm
from dashred.evaluation.foreign.cases.field_equations import FieldEquation
from dashred.evaluation.foreign.cases.field_solver import FieldSolver, Texts

# Width of a source as a share of the axis, and its peak in units of the rms tendency.
SOURCE_WIDTHS, SOURCE_PEAKS = (0.03, 0.06), (1.0, 2.5)
# Half the extent of a source in its widths; the peak of a map has to be inside.
SOURCE_REACH = 2.0
PULSES_PER_RECORD = (1.5, 3.5)
# Extent of a region as a share of the axis, its edges, and the rms of its term in units of the
# rms tendency.
REGION_WIDTHS, REGION_EDGE, REGION_SIZES = (0.2, 0.35), 0.01, (0.4, 1.0)


@dataclass(frozen=True)
class Hidden:
    """What the simulator lacks.

    Attributes:
        says: as text.
        texts: terms by equation, in the equation language of the solver.
        removed: the terms of the equation that the simulator is without.
        terms: the law, if the equation language expresses it.
        region: ``(from, to)`` along the first axis.
        period: of a source that pulsates.
    """

    says: str = "nothing"
    texts: Texts = field(default_factory=dict)
    removed: Mapping[str, str] = field(default_factory=dict)
    terms: tuple[TrueTerm, ...] = ()
    region: tuple[float, float] | None = None
    period: float | None = None


def leave_out(equation: FieldEquation, rng: np.random.Generator) -> Hidden:
    """Return one of the effects that may be left out."""
    effect = list(equation.removable)[int(rng.integers(len(equation.removable)))]
    removed = equation.removable[effect]
    return Hidden(
        says=f"{effect}: " + ", ".join(f"{name}: {text}" for name, text in removed.items()),
        texts={name: (text,) for name, text in removed.items()},
        removed=removed,
        terms=tuple(
            TrueTerm(name, text, 1.0, 1 + text.count(" + ")) for name, text in removed.items()
        ),
    )


def draw_source(
    solver: FieldSolver, rms_tendency: float, pulsates: bool, rng: np.random.Generator
) -> Hidden:
    """Return a bell-shaped source in the first equation.

    Args:
        solver: of the field.
        rms_tendency: rms of the tendency of the first equation without the source.
        pulsates: whether its strength varies with time.
        rng: random generator.
    """
    equation = solver.equation
    name, length = next(iter(equation.terms)), equation.length
    width = rng.uniform(*SOURCE_WIDTHS) * length
    centres = rng.uniform(0, length, len(equation.axes))
    peak = round_to(rng.uniform(*SOURCE_PEAKS) * rms_tendency)
    sharpness = (length / (2 * np.pi * width)) ** 2
    bells = [
        f"exp({sharpness:.6g}*(cos(2*pi*({axis} - {centre:.6g})/{length:.12g}) - 1))"
        for axis, centre in zip(equation.axes, centres, strict=True)
    ]
    period = equation.duration / rng.uniform(*PULSES_PER_RECORD) if pulsates else None
    pulse = [f"0.5*(1 + cos(2*pi*t/{period:.6g}))"] if period is not None else []
    text = "*".join([f"{peak:.6g}", *bells, *pulse])
    begin, end = (centres[0] + SOURCE_REACH * width * np.array([-1, 1])) % length
    says = f"{name}: a source about {equation.axes[0]} = {centres[0]:.3g}, of width {width:.2g}"
    if period is not None:
        says += f", that pulsates with a period of {period:.3g}"
    return Hidden(
        says=says, texts={name: (text,)}, region=(float(begin), float(end)), period=period
    )


def draw_region(
    solver: FieldSolver, rms_tendency: float, states: Array, rng: np.random.Generator
) -> Hidden:
    """Return a linear loss of the first field in a region along the first axis.

    Args:
        solver: of the field.
        rms_tendency: rms of the tendency of the first equation without the loss.
        states: without the loss, ``(time, field, *cells)``.
        rng: random generator.
    """
    equation = solver.equation
    name, axis, length = next(iter(equation.terms)), equation.axes[0], equation.length
    width = rng.uniform(*REGION_WIDTHS) * length
    centre = rng.uniform(0, length)
    size = rng.uniform(*REGION_SIZES) * rms_tendency / float(np.sqrt(np.mean(states[:, 0] ** 2)))
    coefficient = -round_to(size)
    # As a function of a periodic coordinate, with slopes of 1/edge at both ends.
    k, edge = 2 * np.pi / length, REGION_EDGE * length
    inner, slope = np.cos(k * width / 2), k * np.sin(k * width / 2)
    window = (
        f"0.5*(1 + tanh((cos({k:.12g}*({axis} - {centre:.6g})) - {inner:.6g})/{slope * edge:.6g}))"
    )
    begin, end = (centre + np.array([-0.5, 0.5]) * width) % length
    return Hidden(
        says=f"{name}: {coefficient:+.3g}·{name} for {axis} from {begin:.3g} to {end:.3g}",
        texts={name: (f"({coefficient:.6g})*{name}*{window}",)},
        terms=(TrueTerm(name, name, coefficient),),
        region=(float(begin), float(end)),
    )


def all_terms(equation: FieldEquation, hidden: Hidden) -> dict[str, tuple[str, ...]]:
    """Return the terms of the truth by equation."""
    return {
        name: (*terms, *(t for t in hidden.texts.get(name, ()) if t not in terms))
        for name, terms in equation.terms.items()
    }


def known_terms(equation: FieldEquation, hidden: Hidden) -> dict[str, Sequence[str]]:
    """Return the terms of the simulator by equation."""
    return {
        name: [text for text in terms if text != hidden.removed.get(name)]
        for name, terms in equation.terms.items()
    }


def round_to(value: float, digits: int = 3) -> float:
    """Round to significant digits."""
    return float(f"{value:.{digits}g}")
