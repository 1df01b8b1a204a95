"""Score all methods against the hidden truth, in a process of its own.

Everything that read the recording is frozen by here: the findings of the analysis by their own
freeze, the fields of the other methods by the hash that was kept with them.
"""

from __future__ import annotations

import json
import math
import sys
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from dashred.core.argument_types import read_number, read_path, whole
from dashred.core.arguments import Command, word
from dashred.core.errors import DONE, InputError, run_entry
from dashred.core.findings.findings import check_freeze, sha256_of, write_json_atomic
from dashred.evaluation.baselines.analyse import FIELDS, LAWS, METHODS, NOT_FOR_SYSTEM, OF_LAWS
from dashred.evaluation.comparison.kept_comparison import (
    COMPARED,
    OTHERS_FAILED,
    UNRESOLVED,
    Compared,
    Comparison,
)

if TYPE_CHECKING:
    import numpy as np

    from dashred.evaluation.twins.scoring import Law
    from dashred.evaluation.twins.sealing import Truth

ESTIMATES = "estimates.nc"
# Parts of an analysis that answer for its methods' seconds.
TRAINED = ("simulate the ensemble", "train SHRED")
ASSIMILATED = (*TRAINED, "assimilate, latent SINDy")
STAGES = {
    "shred": TRAINED,
    "dashred": ASSIMILATED,
    "latent_alg1": ASSIMILATED,
    "latent_alg2": ASSIMILATED,
    "corrected": ("in all",),
}
# Methods that look for a law, whether they find one or not.
LOOKING = ("corrected", "pde_find", *OF_LAWS)


@dataclass(frozen=True, kw_only=True)
class Words:
    """The words of this process."""

    folder: Path = word(read_path, "DIR", "folder of the row")
    noise: float = word(read_number, "0.05", "of the field that PDE-FIND gets")
    seed: int = word(whole(), "0", "of that noise")


COMMAND = Command(
    "python -m dashred.evaluation.comparison.method_scores", Words, "Scores the methods of a row."
)


def main(argv: list[str]) -> int:
    """Write ``compared.json`` and a figure of every method's error beside the findings."""
    words = COMMAND.read(argv)
    check_freeze(words.folder)
    comparison = compare(words.folder, words.noise, words.seed)
    write_json_atomic(words.folder / COMPARED, comparison)
    return DONE


def compare(folder: Path, noise: float, seed: int) -> Comparison:
    """Return how right every method is.

    Args:
        folder: of a row: the findings, what the other methods made of its recording, and its seal.
        noise: std of the noise that PDE-FIND's field gets, as a share of each field's.
        seed: of that noise.

    Raises:
        InputError: something is missing, or was changed after it was frozen.
    """
    from dashred.evaluation.twins.kept_findings import read_findings
    from dashred.evaluation.twins.sealing import open_seal
    from dashred.pipeline.run.provenance import git_commit

    findings = read_findings(folder)
    comparison = Comparison(
        findings_sha256=sha256_of(folder / "findings.json"),
        problem=None,
        listed=None,
        git_commit=git_commit(),
        methods={},
    )
    if not (folder / ESTIMATES).is_file():
        comparison["problem"] = UNRESOLVED
        return comparison
    others = read_others(folder)
    truth, fields = open_seal(folder / "sealed.nc")
    comparison["problem"] = None if others else OTHERS_FAILED
    comparison["listed"] = _listed(findings, truth)
    ended = others["methods"] if others else dict.fromkeys(METHODS, _lost(OTHERS_FAILED))
    comparison["methods"] = _methods(folder, findings, ended, truth, fields, noise, seed)
    return comparison


def _methods(
    folder: Path,
    findings: Mapping[str, Any],
    others: Mapping[str, Mapping[str, Any]],
    truth: Truth,
    fields: tuple[str, ...],
    noise: float,
    seed: int,
) -> dict[str, Compared]:
    from dashred.evaluation.comparison.full_field import pde_find_on_full_field
    from dashred.evaluation.comparison.methods_figure import draw_methods
    from dashred.evaluation.twins.score_command import load_fields, true_states
    from dashred.evaluation.twins.scoring import law_of_truth, rmse, rmse_by_time, scaled_errors
    from dashred.evaluation.twins.truth_figures import methods_to_draw

    errors: dict[str, float] = {}
    curves: dict[str, np.ndarray] = {}
    for name in (ESTIMATES, FIELDS):
        if (folder / name).is_file():
            estimates = load_fields(folder / name)
            real = true_states(estimates, truth, fields, folder / "sealed.nc")
            scaled = scaled_errors(estimates, real, fields)
            errors |= {method: rmse(error) for method, error in scaled.items()}
            shown = methods_to_draw(estimates)
            curves |= {name: rmse_by_time(scaled[method]) for name, method in shown.items()}
    draw_methods(folder, estimates["time"].values, curves, findings.get("units", {}))
    # Of both files the times are those of the fit window.
    full = pde_find_on_full_field(
        findings, folder, fields, estimates["time"].values, real, noise, seed
    )
    ended = {**_of_the_analysis(folder, findings, errors), **others, "pde_find": full}
    law = law_of_truth(findings, truth.terms, truth.concealed.parameters)
    return {name: _compared(findings, law, errors, name, one) for name, one in ended.items()}


def read_others(folder: Path) -> dict[str, Any] | None:
    """Return what the other methods found; None where they failed as a whole.

    Raises:
        InputError: their fields were changed since.
    """
    if not (folder / LAWS).is_file():
        return None
    record = json.loads((folder / LAWS).read_text(encoding="utf-8"))
    fields = folder / FIELDS
    if (sha256_of(fields) if fields.is_file() else None) != record["fields_sha256"]:
        raise InputError("changed after it was frozen", where=str(fields))
    return dict(record)


def _lost(failed: str) -> dict[str, Any]:
    return {"seconds": None, "terms": None, "note": "", "failed": failed}


def _listed(findings: Mapping[str, Any], truth: Truth) -> bool | None:
    """Return whether ambiguous findings list the true law; null of others."""
    from dashred.evaluation.twins.candidate_laws import listed_laws
    from dashred.evaluation.twins.scoring import score_law

    if findings["verdict"] != "ambiguous":
        return None
    hidden = truth.concealed.parameters
    laws = listed_laws(findings)
    return any(score_law({**findings, "terms": law}, truth.terms, hidden)[0] for law in laws)


def _of_the_analysis(
    folder: Path, findings: Mapping[str, Any], errors: Mapping[str, float]
) -> dict[str, dict[str, Any]]:
    """Return how the methods within the analysis ended, in the form of the others."""
    laws: dict[str, Any] = {"corrected": findings["terms"]}
    for name, latent in findings["latent"].items():
        if latent is not None:
            laws[f"latent_{name}"] = [p for p in latent["proposals"] if p["coefficient"]]
    seconds = _seconds(folder)
    return {
        name: _lost("") | {"failed": None, "terms": laws.get(name), "seconds": seconds.get(name)}
        for name in dict.fromkeys([*(n for n in errors if n not in METHODS), *laws])
    }


def _compared(
    findings: Mapping[str, Any],
    true: Law,
    errors: Mapping[str, float],
    name: str,
    ended: Mapping[str, Any],
) -> Compared:
    from dashred.evaluation.twins.scoring import law_of_findings

    error, failed = errors.get(name), ended["failed"]
    if error is not None and not math.isfinite(error):
        error, failed = None, "its field is not finite"
    compared = Compared(
        rmse=error,
        exact=None,
        found=None,
        spurious=None,
        missed=None,
        coefficient_error=None,
        seconds=ended["seconds"],
        note=ended["note"],
        failed=failed,
    )
    terms = ended["terms"]
    if terms is not None:
        law = law_of_findings(dict(findings) | {"terms": terms})
        both = law.keys() & true.keys()
        off = [abs(law[key] / true[key] - 1) for key in both]
        compared["exact"] = law.keys() == true.keys()
        compared["found"] = len(both)
        compared["spurious"] = len(law.keys() - both)
        compared["missed"] = len(true.keys() - both)
        compared["coefficient_error"] = max(off, default=None)
    elif name in LOOKING and ended["note"] != NOT_FOR_SYSTEM:
        # It looked for a law, and has none to show: not even of a twin that hides none.
        compared["exact"] = False
        compared["found"] = compared["spurious"] = 0
        compared["missed"] = len(true)
    return compared


def _seconds(folder: Path) -> dict[str, float]:
    taken = json.loads((folder / "run.json").read_text(encoding="utf-8"))["seconds"]
    return {
        method: sum(taken[stage] for stage in stages)
        for method, stages in STAGES.items()
        if all(stage in taken for stage in stages)
    }


if __name__ == "__main__":
    sys.exit(run_entry(main))
