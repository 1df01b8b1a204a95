"""The ensemble filter on the true law: the best causal estimator that the table has."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from dashred.config import load_config
from dashred.evaluation.baselines.kalman_filter import filter_state
from dashred.evaluation.twins.recorder import true_system
from dashred.evaluation.twins.twin_file import read_twin
from dashred.inference.initial_state.ensemble_filter import FilterLostError
from dashred.physics.runs.ensemble import Ensemble
from dashred.physics.solvers.simulate import simulate
from dashred.pipeline.input.build_problem import build_problem
from dashred.pipeline.run import provenance
from dashred.pipeline.simulation.nominal_run import simulate_nominal

Array = NDArray[np.float64]


def filter_truth(words: list[str], twin: str, members: int) -> tuple[Array | None, str]:
    """Return the filtered fields ``(time, field, *grid)`` and the settings; None if it is lost.

    The members start from the prior of the simulation, as those of the observer do. Localisation
    and inflation make the innovations the most likely.

    Args:
        words: of the analysis of the recording.
        twin: name of the hidden truth.
        members: number of members.
    """
    config = load_config(words, entry="train")
    provenance.prepare_torch(config)
    problem = build_problem(config).without_budget()
    recording = replace(config.recording, twin=twin)
    hidden = read_twin(replace(config, recording=recording))
    with problem.scratch.removed_at_the_end():
        prior = simulate_nominal(problem, {}).prior
        lawful = replace(problem, system=true_system(problem.system, hidden))
        starts = prior.draw(members, problem.rng("true filter"))
        begin = problem.times[:1]
        ensemble = Ensemble(begin, simulate(lawful.system, starts, begin), starts.new_zeros(0))
        try:
            found = filter_state(lawful, ensemble)
        except FilterLostError as lost:
            return None, str(lost)
    return problem.system.grid.own(found.states).numpy(), found.note
