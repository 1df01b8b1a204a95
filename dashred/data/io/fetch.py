"""Download the real pendulum's recording: ``dashred fetch path=pendulum.csv``.

The recording comes from its authors' public repository and is verified against a known hash. An
existing file is never overwritten, and an incomplete download is never kept.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from dashred.core.command_line.argument_types import read_path
from dashred.core.command_line.arguments import Command, argument
from dashred.core.errors import DONE, InputError
from dashred.core.files.atomic import write_text_atomic
from dashred.core.findings.findings import sha256_of
from dashred.data.io.published_recording import PENDULUM, fetch_csv


@dataclass(frozen=True, kw_only=True)
class Arguments:
    """The words of the command."""

    path: Path = argument(
        read_path,
        "FILE.csv",
        "output file; an existing file is verified and not overwritten",
    )
    source: str = argument(
        str,
        "URL|FILE",
        "another URL, or a file that you have downloaded",
        default=PENDULUM.url,
    )


COMMAND = Command(
    "dashred fetch",
    Arguments,
    f"""\
Downloads the recording of a real pendulum that the tutorial (docs/tutorial.md) analyses:
{PENDULUM.contents}.""",
    after=f"Source:  {PENDULUM.citation}\nLicence: {PENDULUM.licence}",
)


def main(argv: list[str]) -> int:
    """Download the recording unless the file already exists."""
    words = COMMAND.read(argv)
    path = words.path
    if _already_exists(path):
        print(f"already exists: {path} (sha256 {PENDULUM.sha256[:12]}… verified)")
        return DONE
    print(f"downloading {words.source}", flush=True)
    _write(path, fetch_csv(PENDULUM, words.source))
    print(f"{path}: {PENDULUM.contents}; sha256 {PENDULUM.sha256[:12]}… verified")
    print(f"source:  {PENDULUM.citation}")
    print(f"licence: {PENDULUM.licence}")
    print(f"next:    dashred train conf=pendulum recording.path={path}")
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
