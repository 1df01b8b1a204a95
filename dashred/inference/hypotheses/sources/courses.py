"""Courses of a source in time: constant, from a time on, periodic, or free."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np
import torch
from torch import Tensor

STEP = 1e-4


class Course(Protocol):
    """The course ``Σ_j a_j h_j(t; ψ)`` of a source, with unknown amplitudes a."""

    @property
    def unknowns(self) -> tuple[float, ...]:
        """The unknowns ψ of the functions h."""

    @property
    def steps(self) -> tuple[float, ...]:
        """The largest change of each unknown in one step of a fit."""

    @property
    def period(self) -> float | None:
        """The period; None if the course is not periodic."""

    @property
    def has_form(self) -> bool:
        """Whether its amplitudes are few and count as parameters of a law."""

    def with_unknowns(self, values: tuple[float, ...]) -> Course:
        """Return the course with other values of ψ."""

    def functions(self, times: Tensor) -> Tensor:
        """Return h at some times, ``(time, function)``."""

    def terms(self, amplitudes: Tensor) -> list[tuple[str, float]]:
        """Return terms of the equation language, with coefficients, whose sum is the course."""


@dataclass(frozen=True)
class Constant:
    """A course that does not change: ``h = 1``."""

    unknowns: tuple[float, ...] = ()
    steps: tuple[float, ...] = ()
    period: None = None
    has_form: bool = True

    def with_unknowns(self, values: tuple[float, ...]) -> Constant:
        """Return the course itself."""
        return self

    def functions(self, times: Tensor) -> Tensor:
        """Return ones, ``(time, 1)``."""
        return torch.ones((len(times), 1), dtype=torch.float64)

    def terms(self, amplitudes: Tensor) -> list[tuple[str, float]]:
        """Return the constant 1."""
        return [("1", float(amplitudes[0]))]


@dataclass(frozen=True)
class Onset:
    """A course that begins at a time: ``h = ½(1 + tanh((t - t₀)/τ))``.

    Attributes:
        begin: t₀.
        rise: τ, which is not fitted.
    """

    begin: float
    rise: float
    period: None = None
    has_form: bool = True

    @property
    def unknowns(self) -> tuple[float, ...]:
        """The beginning t₀."""
        return (self.begin,)

    @property
    def steps(self) -> tuple[float, ...]:
        """The course is nearly linear in t₀ over the time of its rise."""
        return (2 * self.rise,)

    def with_unknowns(self, values: tuple[float, ...]) -> Onset:
        """Return the course with another beginning."""
        return replace(self, begin=values[0])

    def functions(self, times: Tensor) -> Tensor:
        """Return h, ``(time, 1)``."""
        return (0.5 * (1 + torch.tanh((times - self.begin) / self.rise)))[:, None]

    def terms(self, amplitudes: Tensor) -> list[tuple[str, float]]:
        """Return h."""
        text = f"(1 + tanh((t - {self.begin:.6g})/{self.rise:.6g}))/2"
        return [(text, float(amplitudes[0]))]


@dataclass(frozen=True)
class Periodic:
    """A periodic course: 1, ``sin kωt`` and ``cos kωt`` for ``k = 1 … harmonics``.

    Attributes:
        frequency: ω, radians per unit time.
        harmonics: number of harmonics.
        duration: of the record.
    """

    frequency: float
    harmonics: int
    duration: float
    has_form: bool = True

    @property
    def unknowns(self) -> tuple[float, ...]:
        """The frequency ω."""
        return (self.frequency,)

    @property
    def steps(self) -> tuple[float, ...]:
        """A change of ω by this shifts the phase by half a radian over half the record."""
        return (1.0 / self.duration,)

    @property
    def period(self) -> float:
        """``2π/ω``."""
        return 2 * math.pi / self.frequency

    def with_unknowns(self, values: tuple[float, ...]) -> Periodic:
        """Return the course with another frequency."""
        return replace(self, frequency=values[0])

    def second_harmonic(self, amplitudes: Tensor) -> tuple[Periodic, Tensor]:
        """Return the course of 1 and the second harmonic alone, with its amplitudes.

        A course with half the frequency has the second harmonic in place of the first.
        """
        course = replace(self, frequency=2 * self.frequency, harmonics=1)
        return course, amplitudes[[0, 3, 4]]

    def functions(self, times: Tensor) -> Tensor:
        """Return h, ``(time, 1 + 2·harmonics)``."""
        waves = [torch.ones_like(times)]
        for k in range(1, self.harmonics + 1):
            waves += [(k * self.frequency * times).sin(), (k * self.frequency * times).cos()]
        return torch.stack(waves, dim=1)

    def terms(self, amplitudes: Tensor) -> list[tuple[str, float]]:
        """Return every h."""
        angles = [f"{k * self.frequency:.6g}*t" for k in range(1, self.harmonics + 1)]
        texts = ["1", *(f"{wave}({angle})" for angle in angles for wave in ("sin", "cos"))]
        return list(zip(texts, amplitudes.tolist(), strict=True))


@dataclass(frozen=True, eq=False)
class Free:
    """A smooth course without a form, which is linear between knots.

    Attributes:
        knots: ``(knot,)``.
        modes: h at the knots, ``(knot, function)``.
    """

    knots: Tensor
    modes: Tensor
    unknowns: tuple[float, ...] = ()
    steps: tuple[float, ...] = ()
    period: None = None
    has_form: bool = False

    def with_unknowns(self, values: tuple[float, ...]) -> Free:
        """Return the course itself."""
        return self

    def functions(self, times: Tensor) -> Tensor:
        """Return h, ``(time, function)``."""
        hats = [np.interp(times.numpy(), self.knots.numpy(), row) for row in self.modes.T.numpy()]
        return torch.from_numpy(np.stack(hats, axis=1))

    def terms(self, amplitudes: Tensor) -> list[tuple[str, float]]:
        """Return one term ``Σ_k c_k |t - t_k|``, which is linear between the knots.

        It is constant before the first knot and after the last. Its coefficient is its maximum.
        """
        values = self.modes @ amplitudes
        size = float(values.abs().max())
        rates = (values.diff() / self.knots.diff() / size).tolist()
        bends = [b - a for a, b in zip([0.0, *rates], [*rates, 0.0], strict=True)]
        mean = float(values[0] + values[-1]) / 2 / size
        parts = [
            f"{bend / 2:+.5g}*abs(t - {knot:.6g})"
            for bend, knot in zip(bends, self.knots.tolist(), strict=True)
        ]
        return [(f"({mean:.6g}{''.join(parts)})", size)]


def slopes(course: Course, amplitudes: Tensor, times: Tensor) -> list[Tensor]:
    """Return the derivative of ``Σ a_j h_j`` by every unknown, each ``(time,)``.

    Args:
        course: the functions h.
        amplitudes: a, ``(function,)``.
        times: ``(time,)``.
    """
    found = []
    for index, size in enumerate(course.steps):
        values = list(course.unknowns)
        sides = []
        for sign in (1.0, -1.0):
            moved = [*values]
            moved[index] += sign * STEP * size
            sides.append(course.with_unknowns(tuple(moved)).functions(times) @ amplitudes)
        found.append((sides[0] - sides[1]) / (2 * STEP * size))
    return found
