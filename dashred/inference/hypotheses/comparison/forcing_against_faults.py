"""A free forcing against sensor faults: error curves can imitate a source near some sensors."""

from __future__ import annotations

from dataclasses import replace

from dashred.inference.fit.law import Law
from dashred.inference.hypotheses.free_forcing import FreeForcing, evidence
from dashred.inference.hypotheses.hypothesis_fit import HypothesisFit


def is_curves_alone(law: Law) -> bool:
    """Tell whether wandering sensors explain the recording without any law."""
    return not law.candidates and any(fault.kind == "wandering" for fault in law.faults)


def forcing_gain_over(faults: HypothesisFit, null: HypothesisFit, forcing: FreeForcing) -> float:
    """Return the evidence that a free forcing gains over sensor faults, under the same noise.

    Args:
        faults: the uncorrected simulator with sensor faults.
        null: the uncorrected simulator, under the same noise.
        forcing: a forcing on top of the uncorrected simulator, fitted under another noise.
    """
    problem = replace(forcing.objective, noise=null.objective.noise)
    there = replace(forcing, objective=problem, normal=problem.linearise(forcing.phi))
    gain = evidence(null.normal, range(len(null.phi))) - there.evidence
    return faults.law.score - (null.law.score - gain)
