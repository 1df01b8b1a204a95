"""Substitution of parameters and derived quantities (lets) in expressions."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping

from dashred.core.errors import InputError
from dashred.physics.expressions.algebra import Expr, Number, names, substitute, to_text
from dashred.physics.expressions.expression_size import MAX_DEPTH, MAX_NODES, Size, size_of


def check_order(
    name: str, expr: Expr, before: Iterable[str], lets: Iterable[str], where: Callable[[str], str]
) -> None:
    """Check that a let depends only on lets before it.

    Args:
        name: of the let.
        expr: its expression.
        before: names of the lets before it.
        lets: names of all lets.
        where: returns the location of a configuration key.

    Raises:
        InputError: it depends on itself or on a later let.
    """
    if later := (names(expr) & set(lets)) - set(before):
        raise InputError(
            f"let {name!r} reads {min(later)!r}, which is not defined before it",
            where=where(f"system.let.{name}"),
        )


class Definitions:
    """Parameters and lets for substitution in expressions.

    Args:
        parameters: values by name.
        lets: expressions by name; each depends only on lets before it.
        where: returns the location of a configuration key.

    Raises:
        InputError: see :meth:`substitute_into`.
    """

    def __init__(
        self,
        parameters: Mapping[str, float],
        lets: Mapping[str, Expr],
        where: Callable[[str], str],
    ) -> None:
        self._where = where
        self._values: dict[str, Expr] = {k: Number(float(v)) for k, v in parameters.items()}
        self._sizes: dict[str, Size] = {}
        for name, expr in lets.items():
            self._values[name] = self.substitute_into(expr, f"system.let.{name}")
            self._sizes[name] = size_of(expr, self._sizes)

    def substitute_into(self, expr: Expr, key: str) -> Expr:
        """Return an expression with lets and parameters substituted.

        Args:
            expr: the expression.
            key: its configuration key, for error messages.

        Raises:
            InputError: a constant becomes infinite, or the expression becomes too large.
        """
        if size_of(expr, self._sizes).is_too_large:
            problem = "this expression is too large after substitution of its lets"
            hint = f"at most {MAX_NODES} names, numbers and operators, {MAX_DEPTH} levels deep"
            raise InputError(problem, where=self._where(key), hint=hint)
        try:
            return substitute(expr, self._values)
        except (ArithmeticError, ValueError):
            problem = f"with these parameters {to_text(expr)!r} is not finite"
            raise InputError(problem, where=self._where(key)) from None
