"""A public set of cases: recordings whose truths are published only as hashes.

A claimed truth can be checked against its hash; the repository does not contain the truths.
"""

from __future__ import annotations

import csv
import hashlib
import json
import secrets
from collections.abc import Sequence
from copy import deepcopy
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from dashred.core.errors import InputError
from dashred.core.findings.findings import canonical, sha256_of, write_json_atomic
from dashred.data.recording import Recording
from dashred.evaluation.proof.cases.descriptions import describe_hidden
from dashred.evaluation.proof.cases.draw import Case, draw_cases, seed_of
from dashred.evaluation.proof.cases.effect_size import CaseTruth, record_truth
from dashred.pipeline.run.output_dir import make_output

HASHES = "hashes.json"
# Enough digits to estimate the noise, and few enough to be the same on every machine.
DIGITS = 6


def select_cases(draw: str, count: int) -> list[Case]:
    """Return a random selection of cases, because the order of the kinds is public."""
    many = [case for case in draw_cases(seed_of(draw), 8 * count, 0) if not case.words]
    order = np.random.default_rng(seed_of(draw)).permutation(len(many))
    return [many[j] for j in order[:count]]


def publish(cases: Sequence[Case], folder: Path, truths: Path) -> None:
    """Write recordings and configurations into a folder, and the truths elsewhere.

    Args:
        cases: cases to publish.
        folder: folder in the repository.
        truths: private file outside the repository.
    """
    make_output(str(folder))
    hashes: dict[str, Any] = {}
    kept: dict[str, Any] = {}
    for number, case in enumerate(cases, 1):
        name = f"{case.system}-{number}"
        case_truth = record_truth(case)
        _write_recording(
            case_truth.recording, folder / f"{name}.csv", folder / f"{name}-sensors.csv"
        )
        _write_config(case_truth, folder, name)
        kept[name] = _truth(case, case_truth)
        hashes[name] = {
            "recording_sha256": sha256_of(folder / f"{name}.csv"),
            "truth_sha256": hash_of(kept[name]),
        }
    # The truths are written first: without their salts, the hashes could not be verified.
    write_json_atomic(truths, kept)
    write_json_atomic(folder / HASHES, hashes)


def check(folder: Path, truths: Path) -> dict[str, bool]:
    """Return, by name, whether claimed truths match the hashes.

    Raises:
        InputError: a file cannot be read, or a name is unknown.
    """
    try:
        known = json.loads((folder / HASHES).read_text(encoding="utf-8"))
        claimed = json.loads(truths.read_text(encoding="utf-8"))
        return {
            name: hash_of(claim) == known[name]["truth_sha256"] for name, claim in claimed.items()
        }
    except KeyError as error:
        raise InputError(f"there is no public case {error}", where=str(truths)) from None
    except (OSError, ValueError) as error:
        raise InputError(f"cannot be read: {error}", where=str(truths)) from None


def hash_of(truth: Any) -> str:
    """Return the SHA-256 of the canonical JSON of a truth."""
    text = json.dumps(canonical(truth), sort_keys=True, separators=(",", ":"), ensure_ascii=True)
    return hashlib.sha256(text.encode()).hexdigest()


def _truth(case: Case, case_truth: CaseTruth) -> dict[str, Any]:
    truth = case_truth.truth
    return {
        "hidden": describe_hidden(case, truth, case_truth.config),
        "kind": case.kind,
        "terms": [asdict(term) for term in truth.terms],
        "concealed": asdict(truth.concealed),
        # Without a salt, short truths could be found by trying them.
        "salt": secrets.token_hex(16),
    }


def _write_recording(recording: Recording, path: Path, table: Path) -> None:
    with path.open("w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(["time", *recording.names])
        for time, row in zip(recording.times.tolist(), recording.values.tolist(), strict=True):
            writer.writerow([f"{value:.{DIGITS}g}" for value in (time, *row)])
    with table.open("w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(["name", "field", "x", "std"])
        for sensor in recording.sensors:
            place = [f"{x:.12g}" for x in sensor.position]
            writer.writerow([sensor.name, sensor.reads, *place, f"{sensor.std:.{DIGITS}g}"])


def _write_config(truth: CaseTruth, folder: Path, name: str) -> None:
    """Write the system's own configuration, with this recording."""
    config = truth.config
    assert config.source is not None
    values, every = deepcopy(config.written), config.recording.every
    values["recording"] = {"path": f"{name}.csv", "sensors": f"{name}-sensors.csv", "every": every}
    body = yaml.safe_dump(values, sort_keys=False, allow_unicode=True, width=96)
    header = (
        f"# conf/{config.source.name} with a recording whose truth nobody tells; see {HASHES}.\n"
    )
    (folder / f"{name}.yaml").write_text(header + body, encoding="utf-8")
