"""Download the real pendulum's recording: ``python -m dashred.data.io.fetch path=pendulum.csv``.

The recording comes from its authors' public repository and is verified against a known hash. An
existing file is never overwritten, and an incomplete download is never kept.
"""

from __future__ import annotations

import sys
from pathlib import Path

from dashred.core.arguments import read_path_words
from dashred.core.errors import DONE, InputError, run_entry
from dashred.core.files.atomic import write_text_atomic
from dashred.core.files.user_path import user_path
from dashred.core.findings.findings import sha256_of
from dashred.data.io.published_recording import PENDULUM, fetch_csv

EXAMPLE = "python -m dashred.data.io.fetch path=pendulum.csv"
KEYS = ("path", "source")
USAGE = f"""\
usage: python -m dashred.data.io.fetch path=FILE.csv [source=URL|FILE]

Downloads the recording of a real pendulum that the tutorial (docs/tutorial.md) analyses:
{PENDULUM.contents}.

  path=FILE.csv   output file; an existing file is verified and not overwritten
  source=URL      another URL, or a file that you have downloaded; default:
                  {PENDULUM.repository} at commit {PENDULUM.commit[:7]},
                  {PENDULUM.file}

Source:  {PENDULUM.citation}
Licence: {PENDULUM.licence}
"""


def main(argv: list[str]) -> int:
    """Download the recording unless the file already exists."""
    if {"--help", "-h"} & set(argv):
        print(USAGE)
        return DONE
    words = read_path_words(argv, KEYS, "the output file is missing", EXAMPLE)
    path = user_path(words["path"], "path=")
    if _already_exists(path):
        print(f"already exists: {path} (sha256 {PENDULUM.sha256[:12]}… verified)")
        return DONE
    source = words.get("source", PENDULUM.url)
    print(f"downloading {source}", flush=True)
    _write(path, fetch_csv(PENDULUM, source))
    print(f"{path}: {PENDULUM.contents}; sha256 {PENDULUM.sha256[:12]}… verified")
    print(f"source:  {PENDULUM.citation}")
    print(f"licence: {PENDULUM.licence}")
    print(f"next:    python -m dashred.train conf=pendulum recording.path={path}")
    return DONE


def _already_exists(path: Path) -> bool:
    """Return whether the file exists and is the recording.

    Raises:
        InputError: the file exists but is not the recording.
    """
    try:
        if not path.exists():
            return False
        if path.is_file() and sha256_of(path) == PENDULUM.sha256:
            return True
    except OSError as error:
        raise InputError(f"cannot be read: {error.strerror}", where=str(path)) from None
    raise InputError(
        "the file exists but is not this recording; it was not changed",
        where=str(path),
        hint="give another file with path=, or remove this one first",
    )


def _write(path: Path, text: str) -> None:
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        write_text_atomic(path, text)
    except OSError as error:
        what, hint = f"cannot be written: {error.strerror}", "give another file with path="
        raise InputError(what, where=str(path), hint=hint) from None


if __name__ == "__main__":
    sys.exit(run_entry(main))
