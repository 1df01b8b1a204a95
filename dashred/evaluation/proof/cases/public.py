"""A fixed set of cases for everybody: recordings whose truths are told by their hashes alone.

Whoever claims to know a truth can be checked; whoever looks for it in the repository finds nothing.
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
from dashred.evaluation.proof.cases.descriptions import hidden_in_words
from dashred.evaluation.proof.cases.draw import Case, draw_cases, seed_of
from dashred.evaluation.proof.cases.effect_size import Concealed, conceal
from dashred.pipeline.run.output_dir import make_output

HASHES = "hashes.json"
# Enough to read σ off the noise, and no digits that would tell one machine from another.
DIGITS = 6


def choose(draw: str, count: int) -> list[Case]:
    """Return some of many cases: the kinds are dealt out in an order that everybody can read."""
    many = [case for case in draw_cases(seed_of(draw), 8 * count, 0) if not case.words]
    order = np.random.default_rng(seed_of(draw)).permutation(len(many))
    return [many[j] for j in order[:count]]


def publish(cases: Sequence[Case], folder: Path, truths: Path) -> None:
    """Write recordings and configurations into a folder, and the truths elsewhere.

    Args:
        cases: what is published.
        folder: in the repository.
        truths: file outside of it, to be kept by whoever answers claims.
    """
    make_output(str(folder))
    hashes: dict[str, Any] = {}
    kept: dict[str, Any] = {}
    for number, case in enumerate(cases, 1):
        name = f"{case.system}-{number}"
        concealed = conceal(case)
        _write_recording(
            concealed.recording, folder / f"{name}.csv", folder / f"{name}-sensors.csv"
        )
        _write_config(concealed, folder, name)
        kept[name] = _truth(case, concealed)
        hashes[name] = {
            "recording_sha256": sha256_of(folder / f"{name}.csv"),
            "truth_sha256": hash_of(kept[name]),
        }
    # The truths first: without their salts nobody could show them any more.
    write_json_atomic(truths, kept)
    write_json_atomic(folder / HASHES, hashes)


def check(folder: Path, truths: Path) -> dict[str, bool]:
    """Return, by name, whether claimed truths are those that were hashed.

    Raises:
        InputError: a file cannot be read, or a name is unknown.
    """
    try:
        known = json.loads((folder / HASHES).read_text(encoding="utf-8"))
        claimed = json.loads(truths.read_text(encoding="utf-8"))
        return {
            name: hash_of(told) == known[name]["truth_sha256"] for name, told in claimed.items()
        }
    except KeyError as error:
        raise InputError(f"no public case is called {error}", where=str(truths)) from None
    except (OSError, ValueError) as error:
        raise InputError(f"cannot be read: {error}", where=str(truths)) from None


def hash_of(truth: Any) -> str:
    """Return the SHA-256 of a truth, written in one way only."""
    text = json.dumps(canonical(truth), sort_keys=True, separators=(",", ":"), ensure_ascii=True)
    return hashlib.sha256(text.encode()).hexdigest()


def _truth(case: Case, concealed: Concealed) -> dict[str, Any]:
    truth = concealed.truth
    return {
        "hidden": hidden_in_words(case, truth, concealed.config),
        "kind": case.kind,
        "terms": [asdict(term) for term in truth.terms],
        "concealed": asdict(truth.concealed),
        # Without it, short truths could be guessed one after another.
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


def _write_config(concealed: Concealed, folder: Path, name: str) -> None:
    """Write the system's own configuration, with this recording."""
    config = concealed.config
    assert config.source is not None
    values, every = deepcopy(config.written), config.recording.every
    values["recording"] = {"path": f"{name}.csv", "sensors": f"{name}-sensors.csv", "every": every}
    body = yaml.safe_dump(values, sort_keys=False, allow_unicode=True, width=96)
    header = (
        f"# conf/{config.source.name} with a recording whose truth nobody tells; see {HASHES}.\n"
    )
    (folder / f"{name}.yaml").write_text(header + body, encoding="utf-8")
