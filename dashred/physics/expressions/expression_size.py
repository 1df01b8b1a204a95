"""Size of an expression after substitution of its lets, computed without substituting.

A few nested lets can expand to billions of nodes.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from dashred.physics.expressions.nodes import Expr, Name, children

MAX_NODES, MAX_DEPTH = 5000, 100


@dataclass(frozen=True)
class Size:
    """Number of nodes and levels of an expression tree."""

    nodes: int = 1
    depth: int = 1

    @property
    def is_too_large(self) -> bool:
        """Whether the expression exceeds the limits of the analysis."""
        return self.nodes > MAX_NODES or self.depth > MAX_DEPTH


def size_of(expr: Expr, named: Mapping[str, Size]) -> Size:
    """Return the size of an expression after substituting names by expressions of known size."""
    if isinstance(expr, Name):
        return named.get(expr.id, Size())
    below = [size_of(child, named) for child in children(expr)]
    if not below:
        return Size()
    return Size(1 + sum(size.nodes for size in below), 1 + max(size.depth for size in below))
