"""The right-hand side of an ODE system with candidates, and its derivatives."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from dashred.inference.forward.candidates import Candidate
from dashred.inference.segments.segments import Array
from dashred.physics.backends.numpy_backend import Pointwise
from dashred.physics.expressions.algebra import Expr
from dashred.physics.expressions.differentiate import differentiate
from dashred.physics.system import System


@dataclass(frozen=True)
class Tendency:
    """The right-hand side of one system with some candidates, and its derivatives.

    Attributes:
        system: without axes.
        candidates: the terms whose coefficients are ξ.
    """

    system: System
    candidates: tuple[Candidate, ...]

    @cached_property
    def equations(self) -> NDArray[np.intp]:
        """Index of the equation of every term, ``(term,)``."""
        fields = self.system.fields
        return np.array([fields.index(t.equation) for c in self.candidates for t in c.terms], int)

    @cached_property
    def owners(self) -> NDArray[np.intp]:
        """Index of the candidate of every term, ``(term,)``."""
        return np.array([j for j, c in enumerate(self.candidates) for _ in c.terms], int)

    @cached_property
    def _values(self) -> Pointwise:
        return Pointwise([*self._own, *self._terms])

    @cached_property
    def _derivatives(self) -> Pointwise:
        functions = [*self._own, *self._terms]
        slopes = [differentiate(f, name) for f in functions for name in self.system.fields]
        return Pointwise([*functions, *slopes])

    @property
    def _own(self) -> list[Expr]:
        return [self.system.resolved[name] for name in self.system.fields]

    @property
    def _terms(self) -> list[Expr]:
        return [term.expression for c in self.candidates for term in c.terms]

    def rates(
        self, x: Array, xi: Array, clock: Mapping[str, Array], force: Array | float = 0.0
    ) -> Array:
        """Return x', ``(segment, field)``.

        Args:
            x: ``(segment, field)``.
            xi: ``(candidate,)``.
            clock: time and inputs, ``(segment,)`` each.
            force: added to x', ``(segment, field)``.
        """
        found = self._values(self._named(x, clock), (len(x),))
        fields = x.shape[1]
        rates = found[:fields].T.copy()
        if len(xi):
            np.add.at(rates.T, self.equations, xi[self.owners, None] * found[fields:])
        return rates + force

    def linearise(
        self, x: Array, xi: Array, clock: Mapping[str, Array]
    ) -> tuple[Array, Array, Array]:
        """Return x', its Jacobian ``(segment, field, field)``, and θ ``(term, segment)``."""
        fields, count = x.shape[1], len(self.equations)
        found = self._derivatives(self._named(x, clock), (len(x),))
        rates, values = found[:fields].T.copy(), found[fields : fields + count]
        slopes = found[fields + count :].reshape(fields + count, fields, len(x))
        jacobian = slopes[:fields].copy()
        if count:
            np.add.at(rates.T, self.equations, xi[self.owners, None] * values)
            carried = np.flatnonzero(xi[self.owners])
            weighted = xi[self.owners[carried], None, None] * slopes[fields + carried]
            np.add.at(jacobian, self.equations[carried], weighted)
        return rates, np.moveaxis(jacobian, -1, 0), values

    def _named(self, x: Array, clock: Mapping[str, Array]) -> dict[str, Array]:
        return {**clock, **dict(zip(self.system.fields, x.T, strict=True))}
