"""The change of a parameter that corresponds to the coefficient of its tangent.

A law adds ``ξ ∂N/∂p`` to the tendency N, with the tangent at the configured value p₀. If ∂N/∂p
changes with p only by a factor r(p), one other value has exactly the same effect:
``N(p) − N(p₀) = ξ ∂N/∂p`` with ``ξ = ∫ r dp``. A parameter that enters linearly has r = 1. A mass
or another divisor has ``r = p₀²/p²``. For all other parameters the change is ξ to first order.
"""

from __future__ import annotations

import math

from dashred.physics.expressions.algebra import (
    ZERO,
    Expr,
    Number,
    names,
    split_coefficient,
    substitute,
    summands,
)
from dashred.physics.parameter_sensitivity import parameter_slopes
from dashred.physics.runge_kutta import CLASSICAL, advance
from dashred.physics.system import System

# Steps of the Runge–Kutta method from the old value to the new one.
STEPS = 32
# Factor to another value of a parameter, where its tangent is compared.
OTHER_VALUE = 1.25
CLOSE, REVERSIBLE = 1e-9, 1e-3


def parameter_change(system: System, parameter: str, xi: float) -> float:
    """Return the change of a parameter; ξ itself if there is no exact change.

    Args:
        system: the simulator.
        parameter: its name.
        xi: coefficient ξ of its tangent, in the parameter's unit.
    """
    change = exact_change(system, parameter, xi)
    return xi if change is None else change


def is_exact(system: System, parameter: str, xi: float) -> bool:
    """Return whether another value of the parameter has exactly the effect of the law."""
    return exact_change(system, parameter, xi) is not None


def exact_change(system: System, parameter: str, xi: float) -> float | None:
    """Return the change with exactly the effect of the law; None if there is none.

    That of a parameter in a condition at an end of the axis may be correct to first order only.

    See :func:`parameter_change` for the arguments.
    """
    tangent = _Tangent(system, parameter)
    if tangent.is_constant or not tangent.in_equations:
        return xi
    if not tangent.is_proportional:
        # The equations cannot contain the tangent of a boundary condition.
        return xi if _is_in_condition(system, parameter) else None
    value = tangent.integrate(tangent.old_value, xi)
    returned_value = tangent.integrate(value, -xi)
    # Beyond a pole, such as an infinite divisor, the integration does not return to p₀.
    is_reversible = abs(returned_value - tangent.old_value) <= REVERSIBLE * abs(
        value - tangent.old_value
    )
    return value - tangent.old_value if is_reversible else None


def _is_in_condition(system: System, parameter: str) -> bool:
    """Return whether a condition at an end of the axis reads a parameter."""
    given = (end.given for sides in system.conditions.values() for end in sides.values())
    return any(parameter in names(expr) for expr in given)


class _Tangent:
    """``∂N/∂p`` as a function of p."""

    def __init__(self, system: System, parameter: str) -> None:
        self.parameter, self.old_value = parameter, system.config.parameters[parameter]
        self._slopes = parameter_slopes(system, parameter)
        self._others = {name: Number(float(v)) for name, v in system.config.parameters.items()}
        self._old_coefficients = self._coefficients_at(self.old_value)
        other_value = OTHER_VALUE * self.old_value if self.old_value else 1.0
        self._other_ratio = self._ratio(other_value)

    @property
    def is_proportional(self) -> bool:
        """Whether it is the same at another value except for a factor."""
        return self._other_ratio is not None

    @property
    def in_equations(self) -> bool:
        """Whether an equation depends on the parameter; that of a program may not."""
        return any(slope != ZERO for slope in self._slopes.values())

    @property
    def is_constant(self) -> bool:
        """Whether it is the same at another value."""
        return self._other_ratio is not None and abs(self._other_ratio - 1.0) < CLOSE

    def integrate(self, value: float, xi: float) -> float:
        """Return the value of p after a change of ξ from ``value``; NaN if there is none."""
        step = xi / STEPS
        for _ in range(STEPS):
            value = advance(CLASSICAL, lambda p, _: self._slope(p), value, 0.0, step)
        return value

    def _slope(self, value: float) -> float:
        """Return ``dp/dξ = 1/r(p)``; NaN if p cannot have that value."""
        ratio = self._ratio(value)
        return 1.0 / ratio if ratio else math.nan

    def _ratio(self, value: float) -> float | None:
        """Return r(p); None if the tangents differ by more than a factor."""
        coefficients = self._coefficients_at(value) if math.isfinite(value) else {}
        if not coefficients or coefficients.keys() != self._old_coefficients.keys():
            return None
        ratios = [coefficients[part] / number for part, number in self._old_coefficients.items()]
        are_equal = max(ratios) - min(ratios) <= CLOSE * max(map(abs, ratios))
        return ratios[0] if are_equal else None

    def _coefficients_at(self, value: float) -> dict[tuple[str, Expr], float]:
        """Return the coefficient of each summand, by equation and remaining factor."""
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
