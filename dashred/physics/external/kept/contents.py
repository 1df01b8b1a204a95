"""Hashes of the contents of programs."""

from __future__ import annotations

import sys
from collections.abc import Iterable
from hashlib import file_digest, sha256
from pathlib import Path

# Folders whose modules do not belong together.
SHARED = ("site-packages", "dist-packages")


def files_sha256(words: Iterable[str], files: Iterable[Path]) -> str:
    """Return the hash of texts, and of the contents of files."""
    digest = sha256("\0".join(words).encode())
    for path in files:
        with path.open("rb") as file:
            digest.update(file_digest(file, "sha256").digest())
    return digest.hexdigest()


def module_sha256(name: str) -> str:
    """Return the hash of an imported ``MODULE.ATTRIBUTE``.

    It covers the module, and the modules of its package, or of its folder, that are imported. It
    does not cover data files and other packages.
    """
    module = name.rpartition(".")[0]
    top = getattr(sys.modules[module.partition(".")[0]], "__file__", None)
    own = getattr(sys.modules[module], "__file__", None)
    folder = Path(top or own or "/").parent
    found = {Path(own)} if own else set()
    if folder.name not in SHARED and (top or own):
        loaded = (getattr(each, "__file__", None) for each in list(sys.modules.values()))
        paths = (Path(path) for path in loaded if path)
        found |= {path for path in paths if path.is_relative_to(folder)}
    return files_sha256([name], sorted(path for path in found if path.is_file()))
