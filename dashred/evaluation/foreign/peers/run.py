"""Run one method on one case: ``python -m dashred.evaluation.foreign.peers.run METHOD FOLDER``.

Writes ``METHOD.json`` into the folder, the terms of its law.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Mapping
from pathlib import Path

from dashred.core.errors import DONE, run_entry
from dashred.core.findings.findings import write_json_atomic
from dashred.evaluation.baselines.estimate import TermEntry


def main(argv: list[str]) -> int:
    """Run a method on the case in a folder."""
    method, folder = argv[0], Path(argv[1])
    write_json_atomic(folder / f"{method}.json", {"terms": _methods()[method](folder)})
    return DONE


def _methods() -> Mapping[str, Callable[[Path], list[TermEntry]]]:
    from dashred.evaluation.foreign.peers import sindy
    from dashred.evaluation.foreign.peers.ensemble_filter import filter_with_coefficients
    from dashred.evaluation.foreign.peers.full_field import full_field_pde_find
    from dashred.evaluation.foreign.peers.full_state import read_full_state
    from dashred.evaluation.foreign.peers.weak_pde import weak_pde

    return {
        "weak_sindy": lambda folder: sindy.weak_sindy(read_full_state(folder)),
        "ensemble_sindy": lambda folder: sindy.ensemble_sindy(read_full_state(folder)),
        "pde_find": lambda folder: full_field_pde_find(read_full_state(folder)),
        "weak_pde": lambda folder: weak_pde(read_full_state(folder)),
        "filter": filter_with_coefficients,
    }


if __name__ == "__main__":
    sys.exit(run_entry(main))
