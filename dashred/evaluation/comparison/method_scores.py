"""Score all methods against the hidden truth, in a process of its own.

All results are already frozen: the findings of the analysis by their freeze file, the fields of the
other methods by their stored hash.
"""

from __future__ import annotations

import json
import math
import sys
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from dashred.core.command_line.argument_types import integer_reader, read_number, read_path
from dashred.core.command_line.arguments import Command, argument
from dashred.core.command_line.entry import run_entry
from dashred.core.errors import DONE, InputError
from dashred.core.findings.findings import check_freeze, sha256_of, write_json_atomic
from dashred.evaluation.baselines.analyse import FIELDS, LAW_METHODS, LAWS, METHODS, NOT_FOR_SYSTEM
from dashred.evaluation.comparison.comparison_file import (
    COMPARED,
    OTHERS_FAILED,
    UNRESOLVED,
    Comparison,
    MethodScore,
)

if TYPE_CHECKING:
    import numpy as np

    from dashred.evaluation.twins.scoring import Law
    from dashred.evaluation.twins.sealing import Truth

ESTIMATES = "estimates.nc"
# Stages of an analysis whose seconds count for its methods.
TRAINED = ("simulate the ensemble", "train SHRED")
ASSIMILATED = (*TRAINED, "assimilate, latent SINDy")
STAGES = {
    "shred": TRAINED,
    "dashred": ASSIMILATED,
    "latent_alg1": ASSIMILATED,
    "latent_alg2": ASSIMILATED,
    "corrected": ("in all",),
}
# Methods that seek a law, whether they find one or not.
ALL_LAW_METHODS = ("corrected", "pde_find", *LAW_METHODS)


@dataclass(frozen=True, kw_only=True)
class Arguments:
    """The words of this process."""

    folder: Path = argument(read_path, "DIR", "folder of the row")
    noise: float = argument(read_number, "0.05", "of the field that PDE-FIND gets")
    seed: int = argument(integer_reader(), "0", "of that noise")


COMMAND = Command(
    "python -m dashred.evaluation.comparison.method_scores",
    Arguments,
    "Scores the methods of a row.",
)


def main(argv: list[str]) -> int:
    """Write ``compared.json`` and a figure of the errors of all methods next to the findings."""
    words = COMMAND.read(argv)
    check_freeze(words.folder)
    comparison = compare(words.folder, words.noise, words.seed)
    write_json_atomic(words.folder / COMPARED, comparison)
    return DONE


def compare(folder: Path, noise: float, seed: int) -> Comparison:
    """Return the scores of all methods.

    Args:
        folder: folder of a row, with the findings, the results of the other methods and the seal.
        noise: std of the noise on the field of PDE-FIND, as a share of that of each field.
        seed: seed of the noise.

    Raises:
        InputError: a file is missing or was changed after it was frozen.
    """
    from dashred.evaluation.twins.findings_reader import read_findings
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
    ended = others["methods"] if others else dict.fromkeys(METHODS, _failed(OTHERS_FAILED))
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
) -> dict[str, MethodScore]:
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
    # The times of both files are those of the fit window.
    full = pde_find_on_full_field(
        findings, folder, fields, estimates["time"].values, real, noise, seed
    )
    ended = {**_analysis_results(folder, findings, errors), **others, "pde_find": full}
    law = law_of_truth(findings, truth.terms, truth.concealed.parameters)
    return {name: _score(findings, law, errors, name, result) for name, result in ended.items()}


def read_others(folder: Path) -> dict[str, Any] | None:
    """Return the results of the other methods; None if their process failed.

    Raises:
        InputError: their fields have changed since they were frozen.
    """
    if not (folder / LAWS).is_file():
        return None
    record = json.loads((folder / LAWS).read_text(encoding="utf-8"))
    fields = folder / FIELDS
    if (sha256_of(fields) if fields.is_file() else None) != record["fields_sha256"]:
        raise InputError("changed after it was frozen", where=str(fields))
    return dict(record)


def _failed(failed: str) -> dict[str, Any]:
    return {"seconds": None, "terms": None, "note": "", "failed": failed}


def _listed(findings: Mapping[str, Any], truth: Truth) -> bool | None:
    """Return whether ambiguous or unconfirmed findings list the true law; else None."""
    from dashred.evaluation.twins.candidate_laws import listed_laws
    from dashred.evaluation.twins.scoring import score_law

    if findings["verdict"] not in ("ambiguous", "unconfirmed"):
        return None
    hidden = truth.concealed.parameters
    laws = listed_laws(findings)
    return any(score_law({**findings, "terms": law}, truth.terms, hidden)[0] for law in laws)


def _analysis_results(
    folder: Path, findings: Mapping[str, Any], errors: Mapping[str, float]
) -> dict[str, dict[str, Any]]:
    """Return the results of the methods within the analysis, in the form of the others."""
    laws: dict[str, Any] = {"corrected": findings["terms"]}
    for name, latent in findings["latent"].items():
        if latent is not None:
            laws[f"latent_{name}"] = _proposed_law(latent, findings["input"])
    seconds = _seconds(folder)
    return {
        name: _failed("") | {"failed": None, "terms": laws.get(name), "seconds": seconds.get(name)}
        for name in dict.fromkeys([*(n for n in errors if n not in METHODS), *laws])
    }


def _proposed_law(latent: Mapping[str, Any], given: Mapping[str, Any]) -> list[Mapping[str, Any]]:
    """Return the terms and the changes of parameters that the latent space proposes."""
    values = given["config"]["system"]["parameters"]
    changes = latent.get("parameters", {})
    return [
        *(each for each in latent["proposals"] if each["coefficient"]),
        *(
            {"equation": None, "parameter": name, "to": values[name] + change}
            for name, change in changes.items()
        ),
    ]


def _score(
    findings: Mapping[str, Any],
    true: Law,
    errors: Mapping[str, float],
    name: str,
    ended: Mapping[str, Any],
) -> MethodScore:
    from dashred.evaluation.twins.scoring import law_of_findings

    error, failed = errors.get(name), ended["failed"]
    if error is not None and not math.isfinite(error):
        error, failed = None, "its field is not finite"
    compared = MethodScore(
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
    elif name in ALL_LAW_METHODS and ended["note"] != NOT_FOR_SYSTEM:
        # A law was sought and none was found. This is not exact, even if no law is hidden.
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
