"""How large an expression gets when its lets are put in: a few lines of them can make billions."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from dashred.physics.expressions.nodes import Expr, Name, children

MAX_NODES, DEEPEST = 5000, 100


@dataclass(frozen=True)
class Size:
    """Parts of an expression's tree, and levels."""

    nodes: int = 1
    depth: int = 1

    @property
    def too_large(self) -> bool:
        """Whether this is more than anybody writes, and more than the analysis can take."""
        return self.nodes > MAX_NODES or self.depth > MAX_DEPTH


def size_of(expr: Expr, named: Mapping[str, Size]) -> Size:
    """Return the size of an expression with others, of known sizes, put in for names."""
    if isinstance(expr, Name):
        return named.get(expr.id, Size())
    below = [size_of(child, named) for child in children(expr)]
    if not below:
        return Size()
    return Size(1 + sum(size.nodes for size in below), 1 + max(size.depth for size in below))
