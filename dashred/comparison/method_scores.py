"""Hold all methods against the hidden truth: ``python -m dashred.comparison.method_scores …``.

Everything that read the recording is frozen by here: the findings of the analysis by their own
freeze, the fields of the other methods by the hash that was kept with them.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypedDict

from dashred.baselines.analyse import FIELDS, LAWS
from dashred.errors import DONE, InputError, run_entry
from dashred.findings import check_freeze, sha256_of, write_json_atomic

if TYPE_CHECKING:
    import numpy as np

    from dashred.scoring import Law


COMPARED = "compared.json"
KEYS = ("folder", "noise", "seed")
# Parts of an analysis that answer for its methods' seconds.
STAGES = {
    "shred": ("simulate the ensemble", "train SHRED"),
    "dashred": ("simulate the ensemble", "train SHRED", "assimilate, latent SINDy"),
    "corrected": ("in all",),
}


class Compared(TypedDict):
    """How right one method is.

    ``rmse``: of the field over the fit window, in standard deviations. ``found``, ``spurious`` and
    ``missed``: terms. ``coefficient_error``: the worst of those found, relative. Null is what the
    method does not tell.
    """

    rmse: float | None
    found: int | None
    spurious: int | None
    missed: int | None
    coefficient_error: float | None
    seconds: float | None
    note: str


def main(argv: list[str]) -> int:
    """Write ``compared.json`` beside the findings."""
    words = dict(word.partition("=")[::2] for word in argv)
    if words.keys() != set(KEYS):
        hint = " ".join(f"{key}=…" for key in KEYS)
        raise InputError("what to score is missing", where="command line", hint=hint)
    folder = Path(words["folder"])
    check_freeze(folder)
    methods = compare(folder, float(words["noise"]), int(words["seed"]))
    sha256 = sha256_of(folder / "findings.json")
    write_json_atomic(folder / COMPARED, {"findings_sha256": sha256, "methods": methods})
    return DONE


def read_compared(folder: Path) -> dict[str, Compared] | None:
    """Return what was made of these findings; None where nothing was, or of earlier ones."""
    try:
        record = json.loads((folder / COMPARED).read_text(encoding="utf-8"))
        same = record["findings_sha256"] == sha256_of(folder / "findings.json")
        return dict(record["methods"]) if same else None
    except (OSError, ValueError, KeyError):
        return None


def compare(folder: Path, noise: float, seed: int) -> dict[str, Compared]:
    """Return how right every method is.

    Args:
        folder: of a row: the findings, what the other methods made of its recording, and its seal.
        noise: std of the noise that PDE-FIND's field gets, as a share of each field's.
        seed: of that noise.

    Raises:
        InputError: something is missing, or was changed after it was frozen.
    """
    from dashred.score import load_fields, true_states
    from dashred.scoring import law_of_truth, rmse, scaled_errors
    from dashred.sealing import open_seal

    findings = json.loads((folder / "findings.json").read_text(encoding="utf-8"))
    others = read_others(folder)["methods"]
    truth, fields = open_seal(folder / "sealed.nc")
    law = law_of_truth(findings, truth.terms, truth.concealed.parameters)
    errors: dict[str, float] = {}
    laws: dict[str, list[dict[str, Any]] | None] = _laws(findings)
    for name in ("estimates.nc", FIELDS):
        estimates = load_fields(folder / name)
        real = true_states(estimates, truth, fields, folder / "sealed.nc")
        errors |= {m: rmse(e) for m, e in scaled_errors(estimates, real, fields).items()}
    laws |= {name: method["terms"] for name, method in others.items()}
    times = estimates["time"].values
    laws["pde_find"] = _full_field(findings, folder, fields, times, real, noise, seed)
    seconds = _seconds(folder) | {name: method["seconds"] for name, method in others.items()}
    return {
        name: _compared(
            findings,
            law,
            laws.get(name),
            errors.get(name),
            seconds.get(name),
            others[name]["note"] if name in others else "",
        )
        for name in dict.fromkeys([*errors, *laws])
    }


def read_others(folder: Path) -> dict[str, Any]:
    """Return what the other methods found.

    Raises:
        InputError: their fields were changed since.
    """
    record = json.loads((folder / LAWS).read_text(encoding="utf-8"))
    if sha256_of(folder / FIELDS) != record["fields_sha256"]:
        raise InputError("changed after it was frozen", where=str(folder / FIELDS))
    return dict(record)


def _laws(findings: Mapping[str, Any]) -> dict[str, list[dict[str, Any]] | None]:
    """Return the law of the analysis, and those that latent SINDy proposes."""
    laws: dict[str, list[dict[str, Any]] | None] = {"corrected": findings["terms"]}
    for name, latent in findings["latent"].items():
        if latent is not None:
            laws[f"latent_{name}"] = [p for p in latent["proposals"] if p["coefficient"]]
    return laws


def _full_field(
    findings: Mapping[str, Any],
    folder: Path,
    fields: Sequence[str],
    times: np.ndarray,
    real: np.ndarray,
    noise: float,
    seed: int,
) -> list[dict[str, Any]]:
    import numpy as np
    import torch

    from dashred.comparison.pde_find import pde_find
    from dashred.physics.library import build_library
    from dashred.scoring import system_of
    from dashred.sensing.driving import under
    from dashred.sensing.reader import read_recording

    plain = system_of(findings)
    system = under(plain, read_recording(str(folder / "recording.nc"), None, plain).inputs)
    library = build_library(system, findings["input"]["config"]["library"])
    ordered = torch.from_numpy(real[:, [fields.index(field) for field in system.fields]])
    rng = np.random.default_rng([seed, *b"full field"])
    return [
        dict(entry) for entry in pde_find(system, library, torch.tensor(times), ordered, noise, rng)
    ]


def _compared(
    findings: Mapping[str, Any],
    true: Law,
    terms: Sequence[Mapping[str, Any]] | None,
    rmse: float | None,
    seconds: float | None,
    note: str,
) -> Compared:
    from dashred.scoring import law_of_findings

    compared = Compared(
        rmse=rmse,
        found=None,
        spurious=None,
        missed=None,
        coefficient_error=None,
        seconds=seconds,
        note=note,
    )
    if terms is not None:
        law = law_of_findings(dict(findings) | {"terms": terms})
        both = law.keys() & true.keys()
        errors = [abs(law[key] / true[key] - 1) for key in both]
        compared["found"] = len(both)
        compared["spurious"] = len(law.keys() - both)
        compared["missed"] = len(true.keys() - both)
        compared["coefficient_error"] = max(errors, default=None)
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
