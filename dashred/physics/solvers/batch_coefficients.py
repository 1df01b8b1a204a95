"""Layout of the coefficients of a compiled batch: terms, terms within a window, window unknowns."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import torch
from torch import Tensor

from dashred.physics.backends.numba_backend import WindowFactor
from dashred.physics.expressions.algebra import Expr, Number, multiply, substitute
from dashred.physics.window import Shape, Window


@dataclass(frozen=True)
class CoefficientLayout:
    """Columns of the weights of a row: terms, terms within the window, the window's factors.

    Attributes:
        terms: number of terms.
        shapes: the factors that a window may have; empty without windows.
    """

    terms: int
    shapes: tuple[Shape, ...] = ()

    @property
    def count(self) -> int:
        """Number of columns."""
        if not self.shapes:
            return self.terms
        return 2 * self.terms + sum(1 + len(shape.names) for shape in self.shapes)

    def window_column(self, term: int) -> int | None:
        """Return the column of a term's additional coefficient within the window."""
        return self.terms + term if self.shapes else None

    def factors(self) -> list[WindowFactor]:
        """Return the possible factors of χ with the columns of their unknowns."""
        result, flag = [], 2 * self.terms
        for shape in self.shapes:
            unknowns = {name: flag + 1 + k for k, name in enumerate(shape.names)}
            result.append(WindowFactor(flag, shape.expression, unknowns))
            flag += 1 + len(shape.names)
        return result

    def weights(self, everywhere: Tensor, inside: Tensor, windows: Sequence[Window]) -> Tensor:
        """Return the weights of a batch, ``(row, column)``.

        Args:
            everywhere: coefficients of the terms, ``(row, term)``.
            inside: additional coefficients within the window, ``(row, term)``.
            windows: window of each row.
        """
        result = torch.zeros((len(everywhere), self.count), dtype=torch.float64)
        result[:, : self.terms] = everywhere
        result[:, self.terms : 2 * self.terms] = inside
        flags = {f.expression: f for f in self.factors()}
        for row, window in zip(result, windows, strict=True):
            factor = flags[window.shape.expression]
            row[factor.flag] = 1.0
            row[list(factor.unknowns.values())] = torch.tensor(window.values, dtype=torch.float64)
        return result

    def window(self, weights: Tensor) -> Expr:
        """Return χ of one row from its weights ``(column,)``."""
        result = [
            substitute(factor.expression, _values(factor, weights))
            for factor in self.factors()
            if weights[factor.flag]
        ]
        return multiply(result)


def _values(factor: WindowFactor, weights: Tensor) -> dict[str, Expr]:
    return {name: Number(float(weights[column])) for name, column in factor.unknowns.items()}
