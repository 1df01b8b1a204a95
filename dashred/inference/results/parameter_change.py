"""The change of a parameter that corresponds to the coefficient of its tangent.

A law adds ``ξ ∂N/∂p`` to the tendency N, taken at the believed value p₀. Where that only grows or
shrinks with p, by a factor r(p), one other value does exactly the same: ``N(p) − N(p₀)`` is
``ξ ∂N/∂p`` with ``ξ = ∫ r dp``. What enters linearly has r = 1, a mass or another divisor
``r = p₀²/p²``. Of all others the change is ξ to first order.
"""

from __future__ import annotations

import math

from dashred.physics.expressions.algebra import (
    Expr,
    Number,
    split_coefficient,
    substitute,
    summands,
)
from dashred.physics.parameter_sensitivity import parameter_slopes
from dashred.physics.runge_kutta import CLASSICAL, advance
from dashred.physics.system import System

# Of Runge and Kutta's method, from the old value to the new.
STEPS = 32
# Another value, at which a parameter's effect is compared.
ELSEWHERE = 1.25
CLOSE, RETURNED = 1e-9, 1e-3


def parameter_change(system: System, parameter: str, xi: float) -> float:
    """Return by how much a parameter is other than believed: ξ itself, where that is not exact.

    Args:
        system: the simulator.
        parameter: its name.
        xi: coefficient ξ of its tangent, in the parameter's unit.
    """
    change = exact_change(system, parameter, xi)
    return xi if change is None else change


def is_exact(system: System, parameter: str, xi: float) -> bool:
    """Return whether another value of a parameter has exactly the effect of the law."""
    return exact_change(system, parameter, xi) is not None


def exact_change(system: System, parameter: str, xi: float) -> float | None:
    """Return the change with exactly the effect of the law; None where there is none.

    Arguments as :func:`parameter_change` has them.
    """
    tangent = _Tangent(system, parameter)
    if tangent.is_constant:
        return xi
    if not tangent.keeps_its_shape:
        return None
    value = tangent.followed(tangent.believed, xi)
    back = tangent.followed(value, -xi)
    # Beyond a pole, as of a divisor that becomes infinite, there is no way back.
    returned = abs(back - tangent.believed) <= RETURNED * abs(value - tangent.believed)
    return value - tangent.believed if returned else None


class _Tangent:
    """``∂N/∂p`` as a function of p."""

    def __init__(self, system: System, parameter: str) -> None:
        self.parameter, self.believed = parameter, system.config.parameters[parameter]
        self._slopes = parameter_slopes(system, parameter)
        self._others = {name: Number(float(v)) for name, v in system.config.parameters.items()}
        self._here = self._at(self.believed)
        elsewhere = ELSEWHERE * self.believed if self.believed else 1.0
        self._elsewhere = self._ratio(elsewhere)

    @property
    def keeps_its_shape(self) -> bool:
        """Whether it is the same but for a factor, at another value."""
        return self._elsewhere is not None

    @property
    def is_constant(self) -> bool:
        """Whether it is the same at another value."""
        return self._elsewhere is not None and abs(self._elsewhere - 1.0) < CLOSE

    def followed(self, value: float, xi: float) -> float:
        """Return p where ξ has grown by so much; not a number where there is none."""
        step = xi / STEPS
        for _ in range(STEPS):
            value = advance(CLASSICAL, lambda p, _: self._slope(p), value, 0.0, step)
        return value

    def _slope(self, value: float) -> float:
        """Return ``dp/dξ = 1/r(p)``; not a number where p cannot have that value."""
        ratio = self._ratio(value)
        return 1.0 / ratio if ratio else math.nan

    def _ratio(self, value: float) -> float | None:
        """Return r; None where there is none."""
        there = self._at(value) if math.isfinite(value) else {}
        if not there or there.keys() != self._here.keys():
            return None
        ratios = [there[part] / number for part, number in self._here.items()]
        alike = max(ratios) - min(ratios) <= CLOSE * max(map(abs, ratios))
        return ratios[0] if alike else None

    def _at(self, value: float) -> dict[tuple[str, Expr], float]:
        """Return the numbers of its summands, by equation and what they multiply."""
        values = self._others | {self.parameter: Number(value)}
        found: dict[tuple[str, Expr], float] = {}
        for equation, slope in self._slopes.items():
            try:
                parts = summands(substitute(slope, values))
            except (ArithmeticError, ValueError):
                return {}
            for number, rest in map(split_coefficient, parts):
                if number:
                    found[equation, rest] = number
        return found
