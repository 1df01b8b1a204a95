"""Parameters of the simulator whose changes no term of the library expresses."""

from __future__ import annotations

import math

from dashred.inference.forward.candidates import Candidate, build_candidates
from dashred.pipeline.problem import Problem
from dashred.pipeline.simulation.nominal_run import NominalRun
from dashred.pipeline.simulation.state_samples import state_samples


def free_parameters(problem: Problem, nominal: NominalRun) -> list[Candidate]:
    """Return the parameters, of which no two have the same effect along the simulation.

    Args:
        problem: recording and settings.
        nominal: simulation along which effects are compared.
    """
    samples = state_samples(problem, nominal)
    candidates = build_candidates(
        samples.system, problem.library, samples.states, samples.times, moved=samples.moved
    )
    return [
        each
        for each in candidates
        if each.equation is None and not each.replaces and math.isfinite(each.scale)
    ]
