"""The polynomial systems of ``dysts``.

Source: Gilpin, *Chaos as an interpretable benchmark for forecasting and data-driven modelling*
(NeurIPS 2021), https://github.com/williamgilpin/dysts.
"""

from __future__ import annotations

import inspect
from dataclasses import dataclass
from functools import cache, cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dashred.evaluation.foreign.cases.case import Array
from dashred.evaluation.foreign.cases.polynomials import Polynomial, read_polynomials
from dashred.evaluation.foreign.optional import import_optional

NAMES = "xyzw"
SIZES = (3, 4)
DEGREE = 3


@dataclass(frozen=True)
class PolynomialSystem:
    """An autonomous system with polynomial equations.

    Attributes:
        name: in the collection.
        equations: one polynomial a variable.
        start: initial state of the collection.
        period: dominant period, as the collection states it.
    """

    name: str
    equations: tuple[Polynomial, ...]
    start: tuple[float, ...]
    period: float

    @property
    def variables(self) -> str:
        """Names of the variables, one letter each."""
        return NAMES[: len(self.equations)]

    def tendency(self, states: Array) -> Array:
        """Return the tendencies ``(time, variable)`` of states ``(time, variable)``."""
        powers, coefficients = self._arrays
        columns = np.prod(states[:, None, :] ** powers, axis=2)
        return np.asarray(columns @ coefficients)

    @cached_property
    def _arrays(self) -> tuple[NDArray[np.int64], Array]:
        """Powers ``(monomial, variable)`` and coefficients ``(monomial, equation)``."""
        count = len(self.equations)
        used = sorted({monomial for equation in self.equations for monomial in equation})
        powers = np.array([[monomial.count(i) for i in range(count)] for monomial in used])
        coefficients = [[equation.get(m, 0.0) for equation in self.equations] for m in used]
        return powers, np.array(coefficients)


@cache
def polynomial_systems() -> dict[str, PolynomialSystem]:
    """Return all autonomous polynomial systems of 3 or 4 variables, by name in order.

    Raises:
        InputError: ``dysts`` is not installed.
    """
    flows = import_optional("dysts.flows")
    base = import_optional("dysts.base").DynSys
    classes = sorted(
        (name, kind)
        for name, kind in inspect.getmembers(flows, inspect.isclass)
        if issubclass(kind, base) and kind.__module__ == flows.__name__
    )
    read = (_read(name, kind, base) for name, kind in classes)
    return {system.name: system for system in read if system is not None}


def _read(name: str, kind: Any, base: Any) -> PolynomialSystem | None:
    flow = kind()
    start = tuple(float(value) for value in np.ravel(getattr(flow, "ic", ())))
    if len(start) not in SIZES or not getattr(flow, "period", None):
        return None
    # The plain function: compiling each system would take minutes.
    plain = getattr(flow._rhs, "py_func", flow._rhs)
    parameters = list(flow.param_list)
    own = kind.rhs is not base.rhs

    def rhs(state: Array, t: float = 0.0) -> Any:
        return flow.rhs(state, t) if own else plain(*map(float, state), t, *parameters)

    probe = np.linspace(0.3, 0.9, len(start))
    equations = read_polynomials(rhs, len(start), DEGREE)
    if equations is None or not np.allclose(rhs(probe), rhs(probe, 1.7), rtol=1e-12, atol=0):
        return None
    return PolynomialSystem(name, tuple(equations), start, float(flow.period))
