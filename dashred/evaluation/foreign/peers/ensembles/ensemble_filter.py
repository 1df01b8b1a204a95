"""The ensemble Kalman filter with the coefficients of all terms in its state, on the recording."""

from __future__ import annotations

from pathlib import Path

from dashred.config import load_config
from dashred.evaluation.baselines.estimate import TermEntry
from dashred.evaluation.foreign.cases.case_files import CONFIG


def filter_with_coefficients(folder: Path) -> list[TermEntry]:
    """Return the significant terms; the filter reads the sensors only.

    Raises:
        FilterLostError: the filter is lost under every setting.
        InputError: the simulator cannot be run.
    """
    from dashred.evaluation.baselines.kalman_filter import filter_augmented
    from dashred.physics.runs.ensemble import Ensemble
    from dashred.pipeline.discovery.identifiable_terms import keep_identifiable_terms
    from dashred.pipeline.input.build_problem import build_problem
    from dashred.pipeline.run import provenance
    from dashred.pipeline.simulation.nominal_run import simulate_nominal
    from dashred.pipeline.simulation.state_samples import StateSamples

    config = load_config([f"conf={folder / CONFIG}", "threads=1"], entry="train")
    provenance.prepare_torch(config)
    problem = build_problem(config)
    nominal = simulate_nominal(problem, {})
    problem = keep_identifiable_terms(
        problem, StateSamples(problem.system, nominal.states, problem.times)
    )
    # The filter needs the starts of its members only: their runs may blow up without the readings.
    starts = nominal.prior.draw(config.simulation.members, problem.rng("filter members"))
    members = Ensemble(problem.times[:1], starts[:, None], starts.new_zeros((len(starts), 0)))
    return filter_augmented(problem, members, nominal.references[0]).terms or []
