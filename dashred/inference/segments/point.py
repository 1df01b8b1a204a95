"""Values of the unknowns of a weak-constraint problem, and its derivatives there."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from dashred.inference.segments.segments import Array

# The changes where no parameter is uncertain.
NO_CHANGES: Array = np.zeros(0)


@dataclass(frozen=True)
class Point:
    """Values of the unknowns.

    Attributes:
        nodes: x_k, ``(segment, field)``.
        xi: ξ, ``(candidate,)``.
        walked: u_k, ``(segment, component)``.
        parameters: changes of the uncertain parameters, ``(parameter,)``.
    """

    nodes: Array
    xi: Array
    walked: Array
    parameters: Array = field(default_factory=lambda: NO_CHANGES)

    @classmethod
    def at(cls, nodes: Array, count: int, parameters: Array = NO_CHANGES) -> Point:
        """Return the point of some nodes, without a law and without walks.

        Args:
            nodes: x_k, ``(segment, field)``.
            count: number of candidates.
            parameters: changes of the uncertain parameters, ``(parameter,)``.
        """
        return cls(nodes, np.zeros(count), np.zeros((len(nodes), 0)), parameters)

    def moved(self, nodes: Array, members: Sequence[int], xi: Array) -> Point:
        """Return another point.

        Args:
            nodes: change of the states and the walks, ``(segment, field + component)``.
            members: indices of some candidates.
            xi: change of their coefficients, then of the parameters, ``(member + parameter,)``.
        """
        fields, count, coefficients = self.nodes.shape[1], len(members), self.xi.copy()
        coefficients[list(members)] += xi[:count]
        walked, parameters = self.walked + nodes[:, fields:], self.parameters + xi[count:]
        return Point(self.nodes + nodes[:, :fields], coefficients, walked, parameters)

    def only(self, members: Sequence[int]) -> Point:
        """Return the point with the coefficients of other candidates set to zero."""
        chosen, xi = list(members), np.zeros_like(self.xi)
        xi[chosen] = self.xi[chosen]
        return replace(self, xi=xi)


@dataclass(frozen=True)
class Linearisation:
    """States about a point and their derivatives with respect to x_k, u_k, ξ and parameters.

    Attributes:
        states: ``(segment, sample, field)``.
        ahead: derivative of what a segment hands to the next, ``(segment, field + component,
            field + component + member + parameter)``.
        readings: derivative of the readings, ``(segment, sample, sensor,
            field + component + member + parameter)``.
    """

    states: Array
    ahead: Array
    readings: Array
