"""Parser of the equation language: text → expression tree.

The parser accepts a whitelist of syntax and evaluates nothing. Allowed are numbers, known names,
``+ - * / **``, ``> >= < <=``, ``and or not``, the functions of :data:`FUNCTIONS`,
:data:`COMBINATIONS` and :data:`OPERATORS`, and ``interp(x, TABLE)``. Everything else (attributes,
subscripts, calls of other names, keywords, strings) is an error, and its message points at the
column.
"""

from __future__ import annotations

import ast
import keyword
import math
import re
import warnings
from collections.abc import Collection, Mapping
from dataclasses import dataclass, field
from itertools import pairwise

from dashred.core.errors import InputError, nearest
from dashred.physics.expressions import algebra
from dashred.physics.expressions.algebra import Expr, Name, Number
from dashred.physics.expressions.combinations import (
    COMBINATIONS,
    is_greater,
    negation,
)
from dashred.physics.expressions.expression_size import size_of
from dashred.physics.expressions.functions import FUNCTIONS
from dashred.physics.expressions.lookup import Points, interpolate

OPERATORS = frozenset({"d", "lap", "inv_lap", "grad2", "flux"})
LOGIC = frozenset({"and", "or", "not"})
LOOKUP = "interp"
KNOWN = FUNCTIONS.keys() | COMBINATIONS.keys() | OPERATORS | {LOOKUP}
RESERVED = KNOWN | {"pi", "t"}
# A corrected equation may have a term for every parameter of every episode.
MAX_LENGTH = 20000
MAX_DEPTH = 60
MAX_ORDER = 8


@dataclass(frozen=True)
class Vocabulary:
    """What an expression may use.

    Attributes:
        names: of quantities.
        axes: spatial axes.
        transported: field that its fluxes transport; empty for none.
        tables: points of each table.
        radial: whether the only axis is a radius, on which lap is not the second derivative.
    """

    names: frozenset[str]
    axes: tuple[str, ...] = ()
    transported: str = ""
    tables: Mapping[str, Points] = field(default_factory=dict)
    radial: bool = False


def parse(text: str, vocabulary: Vocabulary, *, where: str) -> Expr:
    """Parse one expression into its normal form.

    Raises:
        InputError: the text is not in the language; the message points at the column.
    """
    _check_text(text, where)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            tree = ast.parse(text.strip(), mode="eval").body
    except SyntaxError as error:
        # Python gives no offset where the text ends too early.
        column = (error.offset or len(text.strip()) + 1) - 1
        raise _error(text.strip(), column, error.msg, where) from None
    except (ValueError, RecursionError, MemoryError, SyntaxWarning):
        raise InputError(f"cannot read the expression {text!r}", where=where) from None
    return _Reader(text.strip(), vocabulary, where).read(tree)


def number(text: str, *, where: str) -> float:
    """Evaluate a constant such as ``2*pi`` or ``0.1/15``.

    Raises:
        InputError: the text is not a constant expression.
    """
    expr = parse(text, Vocabulary(frozenset()), where=where)
    if not isinstance(expr, Number):
        raise InputError(f"{text!r} is not a number", where=where)
    return expr.value


def _check_text(text: str, where: str) -> None:
    if not text.strip():
        raise InputError("the expression is empty", where=where)
    if len(text) > MAX_LENGTH:
        raise InputError(f"the expression is longer than {MAX_LENGTH} characters", where=where)
    stripped = text.strip()
    if "\n" in stripped or "#" in stripped:
        raise InputError("an expression is one line without comments", where=where)
    if foreign := re.search(r"[^\t -~]", stripped):
        message = f"{foreign.group()!r} is not allowed: names and signs are plain ASCII"
        raise _error(stripped, foreign.start(), message, where, "write λ as lam, u² as u**2")
    for match in re.finditer(r"[A-Za-z_]\w*", stripped):
        if keyword.iskeyword(word := match.group()) and word not in LOGIC:
            renamed = "lam" if word == "lambda" else f"{word}_0"
            hint = f"rename it, for example to {renamed!r}"
            if word in ("if", "else"):
                hint = "write where(u > 0, a, b) for a where u > 0, else b"
            message = f"{word!r} is a Python keyword and cannot be a name"
            raise _error(stripped, match.start(), message, where, hint)
    if "^" in stripped:
        raise _error(stripped, stripped.index("^"), "powers are written **, not ^", where)


def _error(text: str, column: int, message: str, where: str, hint: str | None = None) -> InputError:
    start = max(0, column - 40)
    shown = text[start : column + 40]
    pointer = f"{shown}\n  {' ' * (column - start)}^"
    return InputError(f"{message} (column {column + 1})\n  {pointer}", where=where, hint=hint)


class _Reader:
    """Converts the allowed part of Python's syntax tree to the normal form."""

    def __init__(self, text: str, vocabulary: Vocabulary, where: str) -> None:
        self.text, self.vocabulary, self.where = text, vocabulary, where

    def fail(self, node: ast.AST, message: str, hint: str | None = None) -> InputError:
        column = getattr(node, "col_offset", 0)
        return _error(self.text, column, message, self.where, hint)

    def read(self, node: ast.AST, depth: int = 0) -> Expr:
        if depth > MAX_DEPTH:
            raise self.fail(node, f"the expression is nested deeper than {MAX_DEPTH} levels")
        try:
            expr = self.read_node(node, depth + 1)
        except (ArithmeticError, ValueError):
            raise self.fail(node, "this constant is not a finite real number") from None
        if isinstance(expr, Number) and not math.isfinite(expr.value):
            raise self.fail(node, "this constant is not a finite real number")
        return expr

    def read_node(self, node: ast.AST, depth: int) -> Expr:
        match node:
            case ast.Constant(value=bool() | str() | bytes() | complex() | None):
                raise self.fail(node, "only real numbers are allowed here")
            case ast.Constant(value=int() | float() as value):
                return Number(float(value))
            case ast.Name(id=id):
                return self.read_name(node, id)
            case ast.UnaryOp(op=ast.USub(), operand=operand):
                return algebra.scale(-1.0, self.read(operand, depth))
            case ast.UnaryOp(op=ast.UAdd(), operand=operand):
                return self.read(operand, depth)
            case ast.Compare() | ast.BoolOp() | ast.UnaryOp(op=ast.Not()):
                return self.read_condition(node, depth)
            case ast.BinOp(op=ast.Add() | ast.Sub()):
                return self.read_sum(node, depth)
            case ast.BinOp(left=left, op=op, right=right):
                return self.read_binary(node, op, self.read(left, depth), self.read(right, depth))
            case ast.Call(func=ast.Name(id=function), args=arguments, keywords=[]):
                return self.read_call(node, function, arguments, depth)
        raise self.fail(node, "this is not part of the equation language", _ALLOWED)

    def read_name(self, node: ast.AST, id: str) -> Expr:
        if id == "pi":
            return Number(math.pi)
        if id in KNOWN:
            raise self.fail(node, f"{id!r} is a function: write {id}(…)")
        if id in self.vocabulary.tables:
            raise self.fail(node, f"{id!r} is a table: write {LOOKUP}(…, {id})")
        if id not in self.vocabulary.names:
            raise self.unknown(node, f"unknown name {id!r}", id, self.vocabulary.names)
        return Name(id)

    def read_sum(self, node: ast.BinOp, depth: int) -> Expr:
        """Read ``a + b - c``, of which the summands are all at one level."""
        left: ast.expr = node
        sums: list[ast.BinOp] = []
        while isinstance(left, ast.BinOp) and isinstance(left.op, ast.Add | ast.Sub):
            sums.append(left)
            left = left.left
        expr = self.read(left, depth)
        for each in reversed(sums):
            expr = self.read_binary(each, each.op, expr, self.read(each.right, depth))
        return expr

    def read_binary(self, node: ast.AST, op: ast.operator, left: Expr, right: Expr) -> Expr:
        match op:
            case ast.Add():
                return algebra.add((left, right))
            case ast.Sub():
                return algebra.add((left, algebra.scale(-1.0, right)))
            case ast.Mult():
                return algebra.multiply((left, right))
            case ast.Div():
                return algebra.multiply((left, algebra.power(right, Number(-1.0))))
            case ast.Pow():
                return algebra.power(left, right)
        raise self.fail(node, "this operator is not part of the equation language", _ALLOWED)

    def read_condition(self, node: ast.AST, depth: int) -> Expr:
        """Read a comparison, or conditions joined by and, or, not; its values are 0 and 1."""
        match node:
            case ast.Compare(left=left, ops=operators, comparators=others):
                values = [self.read(part, depth) for part in (left, *others)]
                pairs = zip(operators, pairwise(values), strict=True)
                compared = [self.read_comparison(node, sign, *pair) for sign, pair in pairs]
                return self.limited(node, algebra.multiply(compared))
            case ast.UnaryOp(op=ast.Not(), operand=operand):
                return negation(self.read_condition(operand, depth + 1))
            case ast.BoolOp(op=ast.And(), values=parts):
                return algebra.multiply(self.read_condition(part, depth + 1) for part in parts)
            case ast.BoolOp(values=parts):
                read = (negation(self.read_condition(part, depth + 1)) for part in parts)
                return negation(algebra.multiply(read))
            case ast.Call(func=ast.Name(id="step")):
                return self.read(node, depth)
        raise self.fail(node, "this is not a condition", "write a comparison, such as u > 0")

    def read_comparison(self, node: ast.AST, operator: ast.cmpop, a: Expr, b: Expr) -> Expr:
        match operator:
            case ast.Gt():
                return is_greater(a, b)
            case ast.Lt():
                return is_greater(b, a)
            case ast.GtE():
                return negation(is_greater(b, a))
            case ast.LtE():
                return negation(is_greater(a, b))
        raise self.fail(node, "a comparison is written with >, >=, < or <=")

    def read_call(
        self, node: ast.AST, function: str, arguments: list[ast.expr], depth: int
    ) -> Expr:
        if function not in KNOWN:
            raise self.unknown(node, f"unknown function {function!r}", function, KNOWN)
        self.check_count(node, function, len(arguments))
        if function in COMBINATIONS:
            return self.read_combination(node, function, arguments, depth)
        operand = self.read(arguments[0], depth)
        if function == LOOKUP:
            return self.limited(node, interpolate(operand, self.read_table(arguments[1])))
        if function in FUNCTIONS:
            return algebra.call(function, operand)
        if not self.vocabulary.axes:
            raise self.fail(node, f"{function}() needs a spatial axis, and the system has none")
        expr = self.read_operator(function, operand, arguments[1:])
        if (order := _order(expr)) > MAX_ORDER:
            raise self.fail(node, f"a derivative of order {order} is above {MAX_ORDER}")
        return expr

    def check_count(self, node: ast.AST, function: str, count: int) -> None:
        if function in COMBINATIONS:
            counts: tuple[int, ...] = (COMBINATIONS[function][0],)
        else:
            counts = {"d": (2, 3), "flux": (2,), LOOKUP: (2,)}.get(function, (1,))
        if count not in counts:
            wanted = " or ".join(map(str, counts))
            plural = "" if counts == (1,) else "s"
            raise self.fail(node, f"{function}() takes {wanted} argument{plural}, not {count}")

    def read_combination(
        self, node: ast.AST, function: str, arguments: list[ast.expr], depth: int
    ) -> Expr:
        read = self.read_condition if function == "where" else self.read
        first, *others = arguments
        operands = [read(first, depth), *(self.read(other, depth) for other in others)]
        return self.limited(node, COMBINATIONS[function][1](*operands))

    def limited(self, node: ast.AST, expr: Expr) -> Expr:
        """Return an expression that repeats its operands, if it has not become too large."""
        if size_of(expr, {}).is_too_large:
            raise self.fail(node, "the expression is too large", "define a part of it as a let")
        return expr

    def read_operator(self, function: str, operand: Expr, rest: list[ast.expr]) -> Expr:
        axes = self.vocabulary.axes
        if function == "lap" and len(axes) == 1 and not self.vocabulary.radial:
            return algebra.derivative(operand, axes[0], 2)
        if function == "grad2" and len(axes) == 1:
            return algebra.power(algebra.derivative(operand, axes[0], 1), Number(2.0))
        if function in {"lap", "inv_lap", "grad2"}:
            return algebra.call(function, operand)
        axis = self.read_axis(rest[0])
        if function == "flux":
            if not self.vocabulary.transported:
                raise self.fail(rest[0], "flux() is allowed in equations and libraries only")
            return algebra.Flux(operand, axis, self.vocabulary.transported)
        return algebra.derivative(operand, axis, self.read_order(rest[1:]))

    def read_table(self, node: ast.expr) -> Points:
        tables = self.vocabulary.tables
        if isinstance(node, ast.Name) and node.id in tables:
            return tables[node.id]
        shown = node.id if isinstance(node, ast.Name) else ast.unparse(node)
        hint = nearest(shown, sorted(tables)) if tables else "state it in system.tables"
        raise self.fail(node, f"{shown!r} is not a table", hint)

    def read_axis(self, node: ast.expr) -> str:
        if isinstance(node, ast.Name) and node.id in self.vocabulary.axes:
            return node.id
        shown = node.id if isinstance(node, ast.Name) else ast.unparse(node)
        raise self.unknown(node, f"{shown!r} is not an axis", shown, self.vocabulary.axes)

    def read_order(self, rest: list[ast.expr]) -> int:
        match rest:
            case []:
                return 1
            case [ast.Constant(value=bool())]:
                pass
            case [ast.Constant(value=int() as order)] if 1 <= order <= MAX_ORDER:
                return order
        message = f"the order of a derivative is a whole number from 1 to {MAX_ORDER}"
        raise self.fail(rest[0], message)

    def unknown(self, node: ast.AST, message: str, id: str, known: Collection[str]) -> InputError:
        return self.fail(node, message, nearest(id, sorted(known)))


def _order(expr: Expr) -> int:
    _, rest = algebra.split_coefficient(expr)
    return max(rest.order, _order(rest.operand)) if isinstance(rest, algebra.Derivative) else 0


_ALLOWED = (
    "allowed: numbers, names, + - * / **, comparisons such as u > 0, and functions such as exp(u), "
    "d(u, x), lap(u)"
)
