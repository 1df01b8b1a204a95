"""What the names of a system stand for: its parameters' values, and its lets."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping

from dashred.core.errors import InputError
from dashred.physics.expressions.algebra import Expr, Number, names, substitute, to_text
from dashred.physics.expressions.expression_size import DEEPEST, MOST_PARTS, Size, size_of


def check_order(
    name: str, expr: Expr, before: Iterable[str], lets: Iterable[str], where: Callable[[str], str]
) -> None:
    """Check that a let reads none but those before it.

    Args:
        name: of the let.
        expr: what it stands for.
        before: the lets before it.
        lets: all of them.
        where: tells the place of a key in the config.

    Raises:
        InputError: it reads a later one, or itself.
    """
    if later := (names(expr) & set(lets)) - set(before):
        raise InputError(
            f"let {name!r} reads {min(later)!r}, which is not defined before it",
            where=where(f"system.let.{name}"),
        )


class Definitions:
    """Parameters and lets, ready to be put into expressions.

    Args:
        parameters: their values.
        lets: each reads none but those before it.
        where: tells the place of a key in the config.

    Raises:
        InputError: see :meth:`put_into`.
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
            self._values[name] = self.put_into(expr, f"system.let.{name}")
            self._sizes[name] = size_of(expr, self._sizes)

    def put_into(self, expr: Expr, key: str) -> Expr:
        """Return an expression without lets and parameters; ``key`` locates it in the config.

        Raises:
            InputError: the parameters make a constant infinite, or the lets the expression huge.
        """
        if size_of(expr, self._sizes).too_large:
            problem = "with the lets that it reads put in, this expression is too large"
            hint = f"{MOST_PARTS} names, numbers and signs at most, {DEEPEST} levels deep"
            raise InputError(problem, where=self._where(key), hint=hint)
        try:
            return substitute(expr, self._values)
        except (ArithmeticError, ValueError):
            problem = f"with these parameters {to_text(expr)!r} is not finite"
            raise InputError(problem, where=self._where(key)) from None
