"""Pointwise functions of a system and of its possible terms, sorted for a compiled kernel."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from dashred.physics.backends.numba_backend import ChannelTerm
from dashred.physics.expressions.algebra import ZERO, Expr
from dashred.physics.expressions.semilinear import (
    OPERAND,
    Input,
    NotSemilinearError,
    SemilinearBuilder,
    SemilinearForm,
    semilinear_form,
)


class Channels:
    """The semilinear forms of a system and of each term, with all functions that they need.

    Attributes:
        base: form of the system.
        forms: form of each term, as if it were the whole equation.
        index: index of each channel, by equation and operator D.
        functions: the functions that are added to the channels.
        inputs: inputs of the functions by name; that of a field itself has the field's name.

    Args:
        equations: tendency of each field, resolved.
        terms: equation and expression of each term that a trajectory may have, resolved.
        axes: names of the spatial axes.
        window_columns: weight of each term within the window of a row; only pointwise terms can
            have a window. None without windows.

    Raises:
        NotSemilinearError, ArithmeticError: see :func:`.semilinear.semilinear_form`.
    """

    def __init__(
        self,
        equations: Mapping[str, Expr],
        terms: Sequence[tuple[str, Expr]],
        axes: Sequence[str],
        window_columns: Sequence[int] | None = None,
    ) -> None:
        zeros = dict.fromkeys(equations, ZERO)
        self.base = semilinear_form(equations, axes)
        self.forms = [semilinear_form({**zeros, name: expr}, axes) for name, expr in terms]
        self.index: dict[tuple[str, Expr], int] = {}
        self.functions = [*self._functions(self.base, None)]
        self.inputs: dict[str, Input] = dict(self.base.inputs)
        for j, form in enumerate(self.forms):
            self.functions += self._functions(form, j)
            self.inputs |= form.inputs
        if window_columns is not None:
            builder = SemilinearBuilder(frozenset(equations), tuple(axes))
            for j, (term, column) in enumerate(zip(terms, window_columns, strict=True)):
                self._add_windowed(builder, j, term, column)
            self.inputs |= builder.inputs

    @property
    def derived(self) -> dict[str, Input]:
        """The inputs that are not fields themselves."""
        return {name: given for name, given in self.inputs.items() if given.operator != OPERAND}

    def _functions(self, form: SemilinearForm, weight: int | None) -> list[ChannelTerm]:
        found = []
        for channel in form.channels:
            if channel.body != ZERO:
                key = channel.equation, channel.operator
                index = self.index.setdefault(key, len(self.index))
                found.append(ChannelTerm(index, channel.body, weight))
        return found

    def _add_windowed(
        self, builder: SemilinearBuilder, j: int, term: tuple[str, Expr], column: int
    ) -> None:
        """Add a pointwise term multiplied by the window."""
        equation, expression = term
        try:
            body = builder.pointwise(expression)
        except NotSemilinearError:
            return
        channel = self.index.setdefault((equation, OPERAND), len(self.index))
        existing = [f for f in self.functions if f == ChannelTerm(channel, body, j)]
        for function in existing:
            self.functions.remove(function)
        weight = j if existing else None
        self.functions.append(ChannelTerm(channel, body, weight, column))
