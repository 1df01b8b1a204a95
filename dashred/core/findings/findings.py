"""Write and freeze the files of the findings.

`findings.json` depends on input, configuration and seed only. It contains no clock time and no
score, its keys are sorted, and its floats are rounded, so that the same run gives the same bytes.
`freeze.json` stores its hash before the truth of a twin experiment is read.
"""

import hashlib
import json
import math
import platform
from collections.abc import Mapping, Sequence
from datetime import UTC, datetime
from importlib import metadata
from pathlib import Path
from typing import Any

from dashred.core.errors import InputError
from dashred.core.files.atomic import write_text_atomic

SIGNIFICANT_DIGITS = 8
PACKAGES = ("dashred", "lightning", "mlflow", "numpy", "pysindy", "scipy", "torch", "torchdiffeq")


def canonical(value: Any) -> Any:
    """Return plain JSON data: floats with 8 significant digits, null for NaN and infinities.

    Arrays and array scalars are converted by `tolist`, so that no array library is imported.

    Raises:
        TypeError: the value has no unique JSON form (sets, paths, keys that are not text).
    """
    if value is None or isinstance(value, bool | str | int):
        return value
    if isinstance(value, float):
        # Adding 0.0 converts -0.0 to 0.0, so that zero has one form.
        return float(f"{value:.{SIGNIFICANT_DIGITS}g}") + 0.0 if math.isfinite(value) else None
    if isinstance(value, Mapping):
        if not all(isinstance(key, str) for key in value):
            raise TypeError(f"JSON keys must be text: {list(value)!r}")
        return {key: canonical(item) for key, item in value.items()}
    if isinstance(value, Sequence) and not isinstance(value, bytes | bytearray):
        return [canonical(item) for item in value]
    if hasattr(value, "tolist"):
        return canonical(value.tolist())
    raise TypeError(f"cannot be written as JSON: {type(value).__name__}")


def write_json_atomic(path: Path, obj: Any) -> None:
    """Write an object as JSON, completely or not at all; the same object gives the same bytes."""
    text = json.dumps(canonical(obj), sort_keys=True, indent=2, ensure_ascii=False, allow_nan=False)
    write_text_atomic(path, f"{text}\n")


def sha256_of(path: Path) -> str:
    """Return the SHA-256 of a file, in hexadecimal."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def freeze(output: Path, files: list[str]) -> None:
    """Write `freeze.json` with the hashes of `findings.json` and of `files`.

    `files` are paths relative to `output`.
    """
    hashes = {name: sha256_of(output / name) for name in sorted({*files, "findings.json"})}
    time = datetime.now(UTC).isoformat(timespec="seconds")
    frozen = {"sha256": hashes["findings.json"], "files": hashes, "time": time}
    write_json_atomic(output / "freeze.json", frozen)


def check_freeze(output: Path) -> None:
    """Check that no frozen file in `output` has changed.

    Raises:
        InputError: there is no valid freeze, or a frozen file is changed or missing.
    """
    path = output / "freeze.json"
    hint = "run the analysis again into a fresh output folder"
    try:
        frozen = json.loads(path.read_text(encoding="utf-8"))
        hashes = dict(frozen["files"])
        is_valid = frozen["sha256"] == hashes["findings.json"]
    except FileNotFoundError:
        raise InputError("the findings have not been frozen", where=str(path), hint=hint) from None
    except (OSError, ValueError, TypeError, KeyError):
        is_valid = False
    if not is_valid:
        raise InputError("this is not a valid freeze", where=str(path), hint=hint)
    for name, digest in hashes.items():
        file = output / name
        if not file.is_file():
            raise InputError("a frozen file is missing", where=str(file), hint=hint)
        if sha256_of(file) != digest:
            raise InputError("changed after it was frozen", where=str(file), hint=hint)


def versions() -> dict[str, str]:
    """Return the versions that determine the findings: Python and the numerical packages."""
    result = {"python": platform.python_version()}
    for package in PACKAGES:
        try:
            result[package] = metadata.version(package)
        except metadata.PackageNotFoundError:
            continue
    return result
