"""Fetch the real pendulum's recording: ``python -m dashred.data.io.fetch path=pendulum.csv``.

It comes from its authors' public repository and is held against a known hash; a file that is
already there is left as it is, and nothing half-fetched is ever kept.
"""

from __future__ import annotations

import sys
from pathlib import Path

from dashred.core.arguments import read_path_words
from dashred.core.errors import DONE, InputError, run_entry
from dashred.core.files.atomic import write_text_atomic
from dashred.core.files.user_path import user_path
from dashred.core.findings.findings import sha256_of
from dashred.data.io.published_recording import PENDULUM, fetched

EXAMPLE = "python -m dashred.data.io.fetch path=pendulum.csv"
KEYS = ("path", "source")
USAGE = f"""\
usage: python -m dashred.data.io.fetch path=FILE.csv [source=URL|FILE]

Fetches the recording of a real pendulum that the tutorial (docs/tutorial.md) analyses:
{PENDULUM.contents}.

  path=FILE.csv   where to put it; what is already there is checked, and left as it is
  source=URL      another place to fetch it from, or a file that you have downloaded; default:
                  {PENDULUM.repository} at commit {PENDULUM.commit[:7]},
                  {PENDULUM.file}

Source:  {PENDULUM.citation}
Licence: {PENDULUM.licence}
"""


def main(argv: list[str]) -> int:
    """Fetch the recording, unless it is there."""
    if {"--help", "-h"} & set(argv):
        print(USAGE)
        return DONE
    words = read_path_words(argv, KEYS, "where to?", EXAMPLE)
    path = user_path(words["path"], "path=")
    if _already_there(path):
        print(f"already there: {path} (sha256 {PENDULUM.sha256[:12]}… as it should be)")
        return DONE
    source = words.get("source", PENDULUM.url)
    print(f"fetching {source}", flush=True)
    _write(path, fetched(PENDULUM, source))
    print(f"{path}: {PENDULUM.contents}; sha256 {PENDULUM.sha256[:12]}… as it should be")
    print(f"source:  {PENDULUM.citation}")
    print(f"licence: {PENDULUM.licence}")
    print(f"next:    python -m dashred.train conf=pendulum recording.path={path}")
    return DONE


def _already_there(path: Path) -> bool:
    """Whether the recording is there.

    Raises:
        InputError: something else is.
    """
    try:
        if not path.exists():
            return False
        if path.is_file() and sha256_of(path) == PENDULUM.sha256:
            return True
    except OSError as error:
        raise InputError(f"cannot be read: {error.strerror}", where=str(path)) from None
    raise InputError(
        "something else is there already, and is left as it is",
        where=str(path),
        hint="name another file with path=, or remove this one first",
    )


def _write(path: Path, text: str) -> None:
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        write_text_atomic(path, text)
    except OSError as error:
        what, hint = f"cannot be written: {error.strerror}", "name another file with path="
        raise InputError(what, where=str(path), hint=hint) from None


if __name__ == "__main__":
    sys.exit(run_entry(main))
