"""The findings files: how they are written, and how they are frozen.

`findings.json` is a function of input, config and seed alone: no clock, no score, sorted keys and
rounded floats, so that the same run gives the same bytes. `freeze.json` fixes its hash before the
seal of a twin experiment is opened.
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
    """Plain JSON data: floats to 8 significant digits, NaN and infinities to null.

    Arrays and array scalars are taken through their `tolist`, so no array library is imported.

    Raises:
        TypeError: for what JSON cannot hold in one way only (sets, paths, keys that are no text).
    """
    if value is None or isinstance(value, bool | str | int):
        return value
    if isinstance(value, float):
        # The sum turns -0.0 into 0.0, which would otherwise give the same number two spellings.
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
    """Write `obj` so that the same object gives the same bytes, and never half of them."""
    text = json.dumps(canonical(obj), sort_keys=True, indent=2, ensure_ascii=False, allow_nan=False)
    write_text_atomic(path, f"{text}\n")


def sha256_of(path: Path) -> str:
    """The SHA-256 of a file's bytes, in hexadecimal."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def freeze(output: Path, files: list[str]) -> None:
    """Fix the findings: write `freeze.json` with the hash of `findings.json` and of `files`.

    `files` are paths relative to `output`; `findings.json` is always among them.
    """
    hashes = {name: sha256_of(output / name) for name in sorted({*files, "findings.json"})}
    time = datetime.now(UTC).isoformat(timespec="seconds")
    frozen = {"sha256": hashes["findings.json"], "files": hashes, "time": time}
    write_json_atomic(output / "freeze.json", frozen)


def check_freeze(output: Path) -> None:
    """Make sure that nothing frozen in `output` has been touched since.

    Raises:
        InputError: if there is no readable freeze, or a frozen file is changed or gone.
    """
    path = output / "freeze.json"
    hint = "run the analysis again into a fresh output folder"
    try:
        frozen = json.loads(path.read_text(encoding="utf-8"))
        hashes = dict(frozen["files"])
        consistent = frozen["sha256"] == hashes["findings.json"]
    except FileNotFoundError:
        raise InputError("the findings have not been frozen", where=str(path), hint=hint) from None
    except (OSError, ValueError, TypeError, KeyError):
        consistent = False
    if not consistent:
        raise InputError("this is not a valid freeze", where=str(path), hint=hint)
    for name, digest in hashes.items():
        file = output / name
        if not file.is_file():
            raise InputError("a frozen file is gone", where=str(file), hint=hint)
        if sha256_of(file) != digest:
            raise InputError("changed after it was frozen", where=str(file), hint=hint)


def versions() -> dict[str, str]:
    """The versions on which the findings depend: Python's and those of the numerical packages."""
    found = {"python": platform.python_version()}
    for package in PACKAGES:
        try:
            found[package] = metadata.version(package)
        except metadata.PackageNotFoundError:
            continue
    return found
