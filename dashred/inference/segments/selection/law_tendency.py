"""What a law adds to the equations at the nodes of the segments."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from dashred.inference.forward.candidates import Candidate
from dashred.inference.segments.segments import Array
from dashred.inference.segments.steps.segment_simulator import SegmentSimulator


def law_tendency(
    simulator: SegmentSimulator, nodes: Array, candidates: Sequence[Candidate], xi: Array
) -> Array:
    """Return what a law adds to the equations, ``(segment, field)``.

    Args:
        simulator: of the segments.
        nodes: states, ``(segment, field)``.
        candidates: of the law.
        xi: their coefficients, ``(candidate,)``.
    """
    _, terms, equations, owners = simulator.tendencies(nodes, candidates)
    found = np.zeros((nodes.shape[1], len(nodes)))
    np.add.at(found, equations, xi[owners, None] * terms)
    return found.T
