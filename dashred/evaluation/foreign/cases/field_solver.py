"""Integrate a field: finite differences by ``py-pde``, time by SciPy's Radau or RK45.

Finite differences on a finer grid than the simulator's share no operator with dashred's spectral
ones. Source: Zwicker, *py-pde: A Python package for solving partial differential equations* (JOSS
5, 2020).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from functools import cached_property
from types import CodeType
from typing import Any

import numpy as np

from dashred.evaluation.foreign.cases.case import Array
from dashred.evaluation.foreign.cases.field_equations import FieldEquation
from dashred.evaluation.foreign.optional import import_optional

TOLERANCE = 1e-6
# Widest stencil of a term: the fourth derivative reaches two cells, a third derivative too.
REACH = 2
Texts = Mapping[str, Sequence[str]]
"""Terms by equation, in the equation language."""


class FieldSolver:
    """The operators of one grid and the fields of one equation, ``(field, *cells)``.

    Args:
        equation: domain and fields.
        parameters: values by name.
    """

    def __init__(self, equation: FieldEquation, parameters: Mapping[str, float]) -> None:
        pde = import_optional("pde")
        self.equation, self.parameters = equation, dict(parameters)
        count = len(equation.axes)
        self.grid = pde.CartesianGrid(
            [[0, equation.length]] * count, [equation.cells] * count, periodic=True
        )
        self.shape = (len(equation.terms), *self.grid.shape)
        self._laplace = self.grid.make_operator("laplace", bc="periodic", backend="scipy")
        self._gradient = self.grid.make_operator("gradient", bc="periodic", backend="scipy")

    @cached_property
    def coordinates(self) -> dict[str, Array]:
        """Coordinates of the centres of the cells by axis, each ``(*cells,)``."""
        axes = np.meshgrid(*self.grid.axes_coords, indexing="ij")
        return dict(zip(self.equation.axes, map(np.asarray, axes), strict=True))

    def tendency(self, texts: Texts) -> Callable[[float, Array], Array]:
        """Return the function ``(t, state)`` of the sum of the terms of each equation."""
        compiled = [
            [compile(text, text, "eval") for text in texts.get(name, ())]
            for name in self.equation.terms
        ]
        lets = {name: compile(text, text, "eval") for name, text in self.equation.let.items()}
        fixed = self._names()

        def tendency(t: float, state: Array) -> Array:
            names = fixed | {"t": t} | dict(zip(self.equation.terms, state, strict=True))
            for name, code in lets.items():
                names[name] = _value(code, names)
            result = np.zeros(self.shape)
            for total, codes in zip(result, compiled, strict=True):
                for code in codes:
                    total += _value(code, names)
            return result

        return tendency

    def start(self, texts: Mapping[str, str]) -> Array:
        """Return the state of an expression for each field."""
        names = self._names() | {"t": 0.0}
        return np.stack(
            [
                np.broadcast_to(_value(compile(texts[name], name, "eval"), names), self.grid.shape)
                for name in self.equation.terms
            ]
        )

    def integrate(self, texts: Texts, start: Array, times: Array) -> Array:
        """Return the states ``(time, field, *cells)``.

        Raises:
            ArithmeticError: the solver fails.
        """
        from scipy.integrate import solve_ivp

        tendency = self.tendency(texts)
        stiff: dict[str, Any] = {"method": "Radau", "jac_sparsity": self._sparsity()}
        method = stiff if self.equation.stiff else {"method": "RK45"}
        solved = solve_ivp(
            lambda t, state: tendency(t, state.reshape(self.shape)).ravel(),
            (times[0], times[-1]),
            start.ravel(),
            rtol=TOLERANCE,
            atol=TOLERANCE * float(np.abs(start).max()),
            t_eval=times,
            **method,
        )
        if not solved.success or not np.isfinite(solved.y).all():
            raise ArithmeticError(f"the truth cannot be integrated: {solved.message}")
        return np.ascontiguousarray(solved.y.T).reshape(len(times), *self.shape)

    def at(self, values: Array, *positions: Array) -> Array:
        """Interpolate ``(..., *cells)`` to points with the given coordinates, ``(..., point)``."""
        rows = [self._waves(axis) for axis in positions]
        modes = np.fft.fftn(values, axes=tuple(range(-len(rows), 0)))
        if len(rows) == 1:
            return np.asarray((modes @ rows[0].T).real)
        return np.asarray(np.einsum("...ij,pi,pj->...p", modes, *rows, optimize=True).real)

    def on_points(self, values: Array) -> Array:
        """Interpolate ``(..., *cells)`` to the grid of the simulator, ``(..., *points)``."""
        places = np.arange(self.equation.points) * self.equation.length / self.equation.points
        mesh = np.meshgrid(*[places] * len(self.equation.axes), indexing="ij")
        axes = [axis.ravel() for axis in mesh]
        shape = (self.equation.points,) * len(axes)
        return self.at(values, *axes).reshape(*values.shape[: -len(shape)], *shape)

    def _waves(self, places: Array) -> np.ndarray[Any, np.dtype[np.complex128]]:
        """Return the weights of the Fourier modes of the cells, ``(place, mode)``."""
        cells, length = self.equation.cells, self.equation.length
        waves = np.fft.fftfreq(cells, 1 / cells)
        from_first = np.asarray(places)[:, None] - length / cells / 2
        weights = np.exp(2j * np.pi * waves * from_first / length) / cells
        weights[:, cells // 2] = 0  # the shortest wave has no phase
        return np.asarray(weights)

    def _names(self) -> dict[str, Any]:
        axes = list(self.coordinates.values())
        functions = {name: getattr(np, name) for name in ("sin", "cos", "exp", "tanh", "abs")}
        return (
            functions
            | self.parameters
            | self.coordinates
            | {
                "pi": math.pi,
                "sech": lambda value: 1 / np.cosh(value),
                "lap": self._laplace,
                "grad2": lambda value: (self._gradient(value) ** 2).sum(axis=0),
                "d": lambda value, axis, order=1: self._derivative(
                    value, next(i for i, known in enumerate(axes) if known is axis), order
                ),
                "inv_lap": self._inverse_laplacian,
            }
        )

    def _derivative(self, value: Array, axis: int, order: int) -> Array:
        """Return ∂ⁿ/∂xⁿ; orders above 1 exist on a line only, where the Laplacian is ∂²/∂x²."""
        for _ in range(order // 2):
            value = self._laplace(value)
        return np.asarray(self._gradient(value)[axis] if order % 2 else value)

    def _inverse_laplacian(self, value: Array) -> Array:
        """Return the solution of ∇²ψ = f without mean, by the FFT."""
        cells = self.equation.cells
        waves = 2 * np.pi * np.fft.fftfreq(cells, self.equation.length / cells)
        squared = np.asarray(sum(np.ix_(*[waves**2] * len(self.equation.axes))))
        squared.flat[0] = np.inf  # the mean of ψ is 0
        return np.asarray(np.fft.ifftn(-np.fft.fftn(value) / squared).real)

    def _sparsity(self) -> Any:
        """Return which cells a tendency depends on: neighbours within reach, in all fields."""
        from scipy import sparse

        cells = self.equation.cells
        offsets = list(range(-REACH, REACH + 1))
        offsets += [k - cells if k > 0 else k + cells for k in offsets if k]
        line = sparse.diags([1.0] * len(offsets), offsets, shape=(cells, cells))
        space = line if len(self.equation.axes) == 1 else sparse.kron(line, line)
        fields = np.ones((self.shape[0],) * 2)
        return sparse.csr_matrix(sparse.kron(fields, space))


def _value(code: CodeType, names: Mapping[str, Any]) -> Array:
    """Evaluate a compiled expression of the tables of this package."""
    return np.asarray(eval(code, {"__builtins__": {}}, dict(names)))
