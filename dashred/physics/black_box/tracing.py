"""Symbolic tracing of a tendency in Python to equations.

The class is called once with symbols in place of tensors, and the operations are recorded in the
equation language. It can then be used like declared equations. A second call with tensors checks
that the equations are complete.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Protocol

import torch
from torch import Tensor

from dashred.physics.black_box.tracing_values import NotTraceableError, Symbol, expression_of
from dashred.physics.expressions import algebra
from dashred.physics.expressions.algebra import Name
from dashred.physics.grids.grid_value import Value
from dashred.physics.grids.operators import Operators
from dashred.physics.solvers.rhs import GridTendency
from dashred.physics.system import System

RELATIVE_TOLERANCE = 1e-9
# Mean values of the states for the check; positive ones for functions such as sqrt.
CENTRES, SPREAD, STATES, TIME = (0.0, 1.0), 0.3, 4, 0.7


class Tendency(Protocol):
    """A simulator in Python: the protocol of ``system.class``, made without arguments."""

    def tendency(self, fields: Any, t: Any, parameters: Any, space: Any) -> Mapping[str, Any]:
        """Return ``∂u/∂t`` of every field by name.

        Args:
            fields: state by name, ``(batch, *grid)``; for an ODE system ``(batch,)``.
            t: time on the recording's clock, a zero-dimensional tensor.
            parameters: by name, zero-dimensional tensors.
            space: spatial derivatives: ``space.d(f, "x", 2)``, ``space.lap(f)``,
                ``space.grad2(f)``; ``space.coordinate("x")``.
        """


class SymbolicSpace:
    """Spatial derivatives of symbols."""

    def __init__(self, axes: Sequence[str]) -> None:
        self.axes = axes

    def d(self, f: Any, axis: str, order: int = 1) -> Symbol:
        """Return ``∂ⁿf/∂xⁿ``."""
        self._check(axis)
        return Symbol(algebra.derivative(expression_of(f), axis, order))

    def lap(self, f: Any) -> Symbol:
        """Return the Laplacian."""
        self._check(*self.axes[:1])
        if len(self.axes) == 1:
            return self.d(f, self.axes[0], 2)
        return Symbol(algebra.call("lap", expression_of(f)))

    def grad2(self, f: Any) -> Symbol:
        """Return ``|∇f|²``."""
        self._check(*self.axes[:1])
        return Symbol(algebra.call("grad2", expression_of(f)))

    def coordinate(self, axis: str) -> Symbol:
        """Return the coordinate of every point."""
        self._check(axis)
        return Symbol(Name(axis))

    def _check(self, *axes: str) -> None:
        if not axes or axes[0] not in self.axes:
            known = ", ".join(self.axes) or "none"
            raise NotTraceableError(f"a derivative along an unknown axis; axes: {known}")


class GridSpace:
    """Spatial derivatives of tensors on a system's grid."""

    def __init__(self, system: System) -> None:
        self.system, self.operators = system, system.operators

    def d(self, f: Tensor, axis: str, order: int = 1) -> Tensor:
        """Return ``∂ⁿf/∂xⁿ``."""
        return _points(self.operators, self.operators.derivative(Value(f), axis, order))

    def lap(self, f: Tensor) -> Tensor:
        """Return the Laplacian."""
        return _points(self.operators, self.operators.laplacian(Value(f)))

    def grad2(self, f: Tensor) -> Tensor:
        """Return ``|∇f|²``."""
        return torch.stack([self.d(f, axis.name) ** 2 for axis in self.system.axes]).sum(dim=0)

    def coordinate(self, axis: str) -> Tensor:
        """Return the coordinate of every point, ``(*grid)``."""
        return self.system.grid.coordinates[axis]


def trace(simulator: Tendency, system: System) -> dict[str, str]:
    """Return the equations of a tendency, by field, in the equation language.

    Args:
        simulator: instance of the class.
        system: with fields, axes and parameters; its equations are ignored.

    Raises:
        NotTraceableError: the class does something that has no counterpart in the language.
    """
    config = system.config
    fields = {name: Symbol(Name(name)) for name in config.fields}
    parameters = {name: Symbol(Name(name)) for name in config.parameters}
    space = SymbolicSpace(list(config.axes))
    found = simulator.tendency(fields, Symbol(Name("t")), parameters, space)
    checked = _by_field(found, system)
    return {name: algebra.to_text(expression_of(value)) for name, value in checked.items()}


@torch.no_grad()
def first_mismatch(simulator: Tendency, system: System) -> str | None:
    """Return the first field whose tendency with tensors differs from its equation, or None.

    Args:
        simulator: instance of the class.
        system: with the equations from :func:`trace`.
    """
    generator = torch.Generator().manual_seed(0)
    tendency = GridTendency(system)
    shape = (STATES, len(system.fields), *system.grid.shape)
    for about in CENTRES:
        noise = torch.randn(shape, generator=generator, dtype=torch.float64)
        state = system.grid.ring(system.grid.own(about + SPREAD * noise))
        expected = tendency(state, TIME)
        fields = dict(zip(system.fields, state.unbind(1), strict=True))
        given = system.config.parameters
        parameters = {n: torch.tensor(value, dtype=torch.float64) for n, value in given.items()}
        t = torch.tensor(TIME, dtype=torch.float64)
        made = simulator.tendency(fields, t, parameters, GridSpace(system))
        for index, (name, value) in enumerate(_by_field(made, system).items()):
            wanted = expected[:, index]
            told = torch.as_tensor(value, dtype=torch.float64).expand(wanted.shape)
            size = float(wanted.nan_to_num().abs().max())
            if not torch.allclose(
                told, wanted, RELATIVE_TOLERANCE, RELATIVE_TOLERANCE * size, equal_nan=True
            ):
                return name
    return None


def _by_field(found: Any, system: System) -> dict[str, Any]:
    if not isinstance(found, Mapping) or set(found) != set(system.fields):
        given = ", ".join(map(str, found)) if isinstance(found, Mapping) else type(found).__name__
        raise NotTraceableError(f"tendency returns {given}, not {', '.join(system.fields)} by name")
    return {name: found[name] for name in system.fields}


def _points(operators: Operators, value: Value) -> Tensor:
    return torch.as_tensor(operators.on_grid(value), dtype=torch.float64)
