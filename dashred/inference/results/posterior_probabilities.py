"""Posterior probabilities of the laws that were tried: ``P(law) ∝ exp(-score/2)``.

They add up to less than 1, because none of these laws may be right.
"""

from __future__ import annotations

import math

from dashred.core.findings.cause_schema import NONE_OF_THESE
from dashred.inference.fit.law import Law
from dashred.inference.forward.candidates import Candidate
from dashred.inference.hypotheses.result import Discovery


def posterior_probabilities(discovery: Discovery) -> list[tuple[Law, float]]:
    """Return each law with its probability among all laws, including the empty law."""
    laws = list(discovery.laws)
    if all(law.candidates for law in laws):
        laws.append(discovery.uncorrected)
    lowest = min(law.score for law in laws)
    weights = [math.exp((lowest - law.score) / 2) for law in laws]
    total = math.fsum(weights)
    # In this order the share of a single law is exactly that of :func:`.verdict.with_faults`.
    return [
        (law, (1 - NONE_OF_THESE) * (weight / total))
        for law, weight in zip(laws, weights, strict=True)
    ]


def inclusion(discovery: Discovery, candidate: Candidate) -> float:
    """Return the total probability of the laws that contain a candidate."""
    name = str(candidate)
    found = (
        p
        for law, p in posterior_probabilities(discovery)
        if name in {str(c) for c in law.candidates}
    )
    return min(1.0, math.fsum(found))
