"""The functions of the equation language, in one table.

The parser, the derivatives, the backends and the documentation all use this table. To add a
function, add one entry to the table.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from enum import Enum
from operator import attrgetter
from types import MappingProxyType
from typing import Any


class Parity(Enum):
    """Symmetry about 0: ``f(-x) = f(x)``, ``f(-x) = -f(x)``, or neither."""

    EVEN = "even"
    ODD = "odd"
    NEITHER = "neither"


@dataclass(frozen=True)
class Function:
    """A function of one real number.

    Attributes:
        name: name in equations.
        scalar: value at a Python float; raises ``ArithmeticError`` or ``ValueError`` outside its
            domain.
        code: Python source of the value, with ``{0}`` for the argument; it may use ``math``.
            Numba compiles it.
        arrays: takes an array library, ``numpy`` or ``torch``, and returns the function of
            arrays.
        derivative: f'(x), in the equation language.
        parity: symmetry about 0.
        unit_power: n, if the unit of f(x) is the unit of x to the power n; 0 for functions of
            dimensionless arguments.
    """

    name: str
    scalar: Callable[[float], float]
    code: str
    arrays: Callable[[Any], Callable[[Any], Any]]
    derivative: str
    parity: Parity = Parity.NEITHER
    unit_power: float = 0.0


def _common(
    name: str, derivative: str, parity: Parity = Parity.NEITHER, unit_power: float = 0.0
) -> Function:
    """Return a function that has the same name in ``math``, NumPy and torch."""
    scalar, code, arrays = getattr(math, name), f"math.{name}({{0}})", attrgetter(name)
    return Function(name, scalar, code, arrays, derivative, parity, unit_power)


def _erf(library: Any) -> Callable[[Any], Any]:
    """Return the error function of arrays, which NumPy does not have."""
    if hasattr(library, "erf"):
        found: Callable[[Any], Any] = library.erf
        return found
    from scipy.special import erf

    return erf


_TABLE = (
    _common("sin", "cos(x)", Parity.ODD),
    _common("cos", "-sin(x)", Parity.EVEN),
    _common("tan", "1 + tan(x)**2", Parity.ODD),
    _common("exp", "exp(x)"),
    _common("log", "1/x"),
    _common("sqrt", "0.5/sqrt(x)", unit_power=0.5),
    _common("sinh", "cosh(x)", Parity.ODD),
    _common("cosh", "sinh(x)", Parity.EVEN),
    _common("tanh", "1 - tanh(x)**2", Parity.ODD),
    _common("atan", "1/(1 + x**2)", Parity.ODD),
    Function(
        "erf",
        scalar=math.erf,
        code="math.erf({0})",
        arrays=_erf,
        derivative="2/sqrt(pi)*exp(-x**2)",
        parity=Parity.ODD,
    ),
    Function(
        "sech",
        scalar=lambda x: 1.0 / math.cosh(x),
        code="1.0 / math.cosh({0})",
        arrays=lambda library: lambda x: 1 / library.cosh(x),
        derivative="-sech(x)*tanh(x)",
        parity=Parity.EVEN,
    ),
    Function(
        "abs",
        scalar=abs,
        code="abs({0})",
        arrays=attrgetter("abs"),
        derivative="sign(x)",
        parity=Parity.EVEN,
        unit_power=1.0,
    ),
    Function(
        "sign",
        scalar=lambda x: float((x > 0) - (x < 0)),
        code="(1.0 if {0} > 0.0 else (-1.0 if {0} < 0.0 else 0.0))",
        arrays=attrgetter("sign"),
        derivative="0",
        parity=Parity.ODD,
    ),
    Function(
        "step",
        scalar=lambda x: float(x > 0),
        code="(1.0 if {0} > 0.0 else 0.0)",
        arrays=lambda library: lambda x: (x > 0) * library.ones_like(x),
        derivative="0",
    ),
)

FUNCTIONS: Mapping[str, Function] = MappingProxyType({f.name: f for f in _TABLE})
"""All functions by name, in the order of the documentation."""
