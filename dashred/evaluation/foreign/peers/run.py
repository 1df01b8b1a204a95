"""Run one method on one case: ``python -m dashred.evaluation.foreign.peers.run METHOD FOLDER``.

Writes ``METHOD.json`` into the folder, the terms of its law.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Mapping
from pathlib import Path

from dashred.core.command_line.entry import run_entry
from dashred.core.errors import DONE, OUR_FAILURE, InputError
from dashred.core.findings.findings import write_json_atomic
from dashred.evaluation.baselines.estimate import TermEntry
from dashred.evaluation.foreign.peers.measured import NoAnswerError


def main(argv: list[str]) -> int:
    """Run a method on the case in a folder."""
    method, folder = argv[0], Path(argv[1])
    try:
        terms = _methods()[method](folder)
    except InputError:
        raise
    except Exception as error:  # The last line is the reason in the row of the method.
        name = "" if isinstance(error, NoAnswerError) else f"{type(error).__name__}: "
        print(f"{name}{error}", file=sys.stderr)
        return OUR_FAILURE
    write_json_atomic(folder / f"{method}.json", {"terms": terms})
    return DONE


def _methods() -> Mapping[str, Callable[[Path], list[TermEntry]]]:
    from dashred.evaluation.foreign.peers import sindy
    from dashred.evaluation.foreign.peers.ensembles.ensemble_filter import filter_with_coefficients
    from dashred.evaluation.foreign.peers.ensembles.ensemble_smoother import smooth_ensemble
    from dashred.evaluation.foreign.peers.ensembles.iterative_smoother import smooth_iteratively
    from dashred.evaluation.foreign.peers.full_field import full_field_pde_find
    from dashred.evaluation.foreign.peers.full_state import read_full_state
    from dashred.evaluation.foreign.peers.measured import all_measured, read_measured
    from dashred.evaluation.foreign.peers.medida import medida_law
    from dashred.evaluation.foreign.peers.shooting.evidence_removal import largest_evidence
    from dashred.evaluation.foreign.peers.shooting.oracle import fit_true_form
    from dashred.evaluation.foreign.peers.shooting.term_removal import joint_state_and_law
    from dashred.evaluation.foreign.peers.true_form import read_true_form
    from dashred.evaluation.foreign.peers.weak_pde import weak_pde

    def oracle(folder: Path) -> list[TermEntry]:
        given = read_measured(folder)
        return fit_true_form(given, read_true_form(folder, given.system))

    def medida(folder: Path) -> list[TermEntry]:
        full = read_full_state(folder)
        return medida_law(full, full.noise)

    return {
        "weak_sindy": lambda folder: sindy.weak_sindy(read_full_state(folder)),
        "ensemble_sindy": lambda folder: sindy.ensemble_sindy(read_full_state(folder)),
        "pde_find": lambda folder: full_field_pde_find(read_full_state(folder)),
        "weak_pde": lambda folder: weak_pde(read_full_state(folder)),
        "medida": medida,
        "medida_as_published": lambda folder: medida_law(read_full_state(folder), 0.0),
        "filter": filter_with_coefficients,
        "joint_full": lambda folder: joint_state_and_law(all_measured(read_full_state(folder))),
        "evidence_full": lambda folder: largest_evidence(all_measured(read_full_state(folder))),
        "joint_sensors": lambda folder: joint_state_and_law(read_measured(folder)),
        "ensemble_smoother": lambda folder: smooth_ensemble(read_measured(folder)),
        "iterative_smoother": lambda folder: smooth_iteratively(read_measured(folder)),
        "oracle": oracle,
    }


if __name__ == "__main__":
    sys.exit(run_entry(main))
