"""A tendency that is written in Python, followed with symbols: what it computes, as equations.

The class is run once with symbols in place of tensors. What it does to them is written down in the
equation language, so that everything that is done with declared equations is done with it. It is
run again with tensors, which shows whether the equations are all that it does.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Protocol

import torch
from torch import Tensor

from dashred.physics.expressions import algebra
from dashred.physics.expressions.algebra import Name
from dashred.physics.external.tracing_values import NotTraceableError, Symbol, expression_of
from dashred.physics.grids.grid_value import Value
from dashred.physics.grids.operators import Operators
from dashred.physics.solvers.rhs import GridTendency
from dashred.physics.system import System

ALIKE = 1e-9
# States about these values are tried: what is only computed of positive ones, too.
ABOUT, SPREAD, TRIED, WHEN = (0.0, 1.0), 0.3, 4, 0.7


class Tendency(Protocol):
    """A simulator in Python: the protocol of ``system.class``, made without arguments."""

    def tendency(self, fields: Any, t: Any, parameters: Any, space: Any) -> Mapping[str, Any]:
        """Return ``∂u/∂t`` of every field by name.

        Args:
            fields: state by name, ``(batch, *grid)``; for an ODE system ``(batch,)``.
            t: the recording's clock.
            parameters: by name, as the configuration has them; as t, tensors without dimensions.
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
            raise NotTraceableError(f"a derivative along an axis that there is not; axes: {known}")


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
    """Return the equations that a tendency computes, by field, in the equation language.

    Args:
        simulator: the class, made.
        system: fields, axes and parameters; its own equations are not looked at.

    Raises:
        NotTraceableError: the class does something that no equation says.
    """
    config = system.config
    fields = {name: Symbol(Name(name)) for name in config.fields}
    parameters = {name: Symbol(Name(name)) for name in config.parameters}
    space = SymbolicSpace(list(config.axes))
    found = simulator.tendency(fields, Symbol(Name("t")), parameters, space)
    checked = _by_field(found, system)
    return {name: algebra.to_text(expression_of(value)) for name, value in checked.items()}


@torch.no_grad()
def equations_differ(simulator: Tendency, system: System) -> str | None:
    """Return the first field whose tendency, with tensors, is not what its equation says.

    Args:
        simulator: the class, made.
        system: with the equations that :func:`trace` has found.
    """
    generator = torch.Generator().manual_seed(0)
    tendency = GridTendency(system)
    shape = (TRIED, len(system.fields), *system.grid.shape)
    for about in ABOUT:
        noise = torch.randn(shape, generator=generator, dtype=torch.float64)
        state = system.grid.ring(system.grid.own(about + SPREAD * noise))
        expected = tendency(state, WHEN)
        fields = dict(zip(system.fields, state.unbind(1), strict=True))
        given = system.config.parameters
        parameters = {n: torch.tensor(value, dtype=torch.float64) for n, value in given.items()}
        t = torch.tensor(WHEN, dtype=torch.float64)
        made = simulator.tendency(fields, t, parameters, GridSpace(system))
        for index, (name, value) in enumerate(_by_field(made, system).items()):
            wanted = expected[:, index]
            told = torch.as_tensor(value, dtype=torch.float64).expand(wanted.shape)
            size = float(wanted.nan_to_num().abs().max())
            if not torch.allclose(told, wanted, ALIKE, ALIKE * size, equal_nan=True):
                return name
    return None


def _by_field(found: Any, system: System) -> dict[str, Any]:
    if not isinstance(found, Mapping) or set(found) != set(system.fields):
        given = ", ".join(map(str, found)) if isinstance(found, Mapping) else type(found).__name__
        raise NotTraceableError(f"tendency returns {given}, not {', '.join(system.fields)} by name")
    return {name: found[name] for name in system.fields}


def _points(operators: Operators, value: Value) -> Tensor:
    return torch.as_tensor(operators.on_grid(value), dtype=torch.float64)
