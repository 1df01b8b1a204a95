"""The words of a bench's command line: what to run, how, and where to."""

from __future__ import annotations

import re
from dataclasses import dataclass, fields
from pathlib import Path

from dashred.config import Settings, bundled
from dashred.core.errors import InputError, nearest
from dashred.core.files.user_path import user_path

CHECKOUT = Path(__file__).resolve().parents[3]
PLACE = "command line"
OWN = ("systems", "twins", "seeds", "noise", "sensors", "extra", "jobs", "output")
# What differs from row to row, or is settled by the bench, and the word that says it here.
TAKEN = {
    "conf": "systems=",
    "seed": "seeds=",
    "twin": "twins=",
    "recording.twin": "twins=",
    "recording.noise": "noise=",
    "recording.sensors": "sensors=",
    "splits.sensors.extra": "extra=",
    "recording.path": "python -m dashred.train: a recording of your own has no truth to bench by",
    "tracking.run": "nothing: every row opens a run of its own",
    "tracking.parent": "nothing: the bench opens the run that the rows are nested below",
}
RANGE = re.compile(r"(\d{1,9})(?:-(\d{1,9}))?\Z")
NUMBER = re.compile(r"-?(\d+(\.\d*)?|\.\d+)(e-?\d{1,2})?\Z")
MOST = 10_000
# Instead of a number of sensors: the system's own.
OWN_NUMBER = "own"

USAGE = """\
usage: python -m dashred.evaluation.bench systems=SYSTEM,... [key=value ...]

Runs `python -m dashred.train` on every combination, each in a process of its own, and ends in a
table. Rows that are done are not run again: after an interruption, give the same command again.

  systems=rde,pendulum   bundled systems ({bundled}),
                         all of them (all), or paths of YAML files
  twins=a,b,null         hidden truths; default: those that start from the simulator's own start
  seeds=0-4 or 0,1,3     default: 0
  noise=0.01,0.05        fraction of each field's standard deviation; default: 0.05
  sensors=own,4,8,20     fit sensors; default: own, the system's own number
  extra=own,0,4          of them, those that SHRED's input is without; default: own
  jobs=2                 rows at once; default: 1, so that nothing disturbs the seconds
  output=DIR             default: {output} (not tracked by git)
  key=value              overrides of every run: simulation.members=96 threads=2; see
                         python -m dashred.train --help

DIR holds a folder a row with its findings, `row.json` and `log.txt`, and above them `table.md` and
`table.json`: the rows of this command, and a summary for each system and noise. A row that failed
is tried again the next time. In MLflow the rows are nested below one run of the experiment
`bench` (tracking.experiment=NAME for another).
"""


@dataclass(frozen=True)
class Request:
    """What one command asks for.

    Attributes:
        systems: bundled names or paths.
        twins: null takes the basic ones of each system.
        sensors: numbers of fit sensors; None for the system's own.
        extra: of them, how many SHRED's input is without; None for the system's own.
        overrides: words for every run.
    """

    systems: tuple[str, ...]
    twins: tuple[str, ...] | None
    seeds: tuple[int, ...]
    noise: tuple[float, ...]
    sensors: tuple[int | None, ...]
    extra: tuple[int | None, ...]
    jobs: int
    output: Path
    overrides: tuple[str, ...]


def read_words(argv: list[str], folder: str = "bench", usage: str = USAGE) -> Request:
    """Read the command line; ``--help`` prints the usage and exits with 0.

    Args:
        argv: the words.
        folder: of the checkout, where the results go by default.
        usage: what ``--help`` prints.

    Raises:
        InputError: an unknown word, or a value that cannot be read.
    """
    default = CHECKOUT / folder
    if {"--help", "-h"} & set(argv):
        print(usage.format(bundled=", ".join(bundled()), output=default), end="")
        raise SystemExit(0)
    given, overrides = _sorted_words(argv)
    if "systems" not in given:
        hint = f"for example systems={','.join(bundled())}"
        raise InputError("which systems? systems= is missing", where=PLACE, hint=hint)
    return Request(
        systems=_systems(given["systems"]),
        twins=_items("twins", given["twins"]) if "twins" in given else None,
        seeds=read_seeds(given.get("seeds", "0")),
        noise=_noise(given.get("noise", "0.05")),
        sensors=_numbers("sensors", given.get("sensors")),
        extra=_numbers("extra", given.get("extra")),
        jobs=_jobs(given.get("jobs", "1")),
        output=user_path(given.get("output") or str(default), "output=").resolve(),
        overrides=overrides,
    )


def read_seeds(text: str) -> tuple[int, ...]:
    """Read ``0-4``, ``0,1,3`` or a mixture of both.

    Raises:
        InputError: it is neither, a range runs backwards, or there are too many.
    """
    hint = "for example seeds=0-4 or seeds=0,1,3"
    seeds: dict[int, None] = {}
    for item in _items("seeds", text):
        match = RANGE.match(item)
        if not match:
            raise InputError(f"seeds={text}: {item!r} is no seed", where=PLACE, hint=hint)
        first, last = int(match[1]), int(match[2] or match[1])
        if last < first:
            raise InputError(f"seeds={text}: {item} runs backwards", where=PLACE, hint=hint)
        if last - first >= MOST:
            raise InputError(f"seeds={text}: more than {MOST} seeds", where=PLACE, hint=hint)
        seeds |= dict.fromkeys(range(first, last + 1))
    return tuple(seeds)


def _sorted_words(argv: list[str]) -> tuple[dict[str, str], tuple[str, ...]]:
    """Return the bench's own words, and those for every run."""
    given: dict[str, str] = {}
    overrides: list[str] = []
    sections = [field.name for field in fields(Settings)]
    for word in argv:
        key, sign, text = word.partition("=")
        if not sign or not key.strip("-") or key.startswith("-"):
            hint = f"write {word.lstrip('-')}" if sign and key.strip("-") else "see --help"
            raise InputError(f"expected key=value, got {word!r}", where=PLACE, hint=hint)
        if key in TAKEN:
            hint = f"use {TAKEN[key]}"
            raise InputError(f"{key}= is not a word of a bench", where=PLACE, hint=hint)
        if key in OWN:
            given[key] = text
        elif key.partition(".")[0] in sections:
            overrides.append(word)
        else:
            hint = nearest(key, [*OWN, *sections])
            raise InputError(f"unknown key {key}", where=PLACE, hint=hint)
    return given, tuple(overrides)


def _systems(text: str) -> tuple[str, ...]:
    return tuple(bundled()) if text == "all" else _items("systems", text)


def _items(key: str, text: str) -> tuple[str, ...]:
    items = [item.strip() for item in text.split(",")]
    if not all(items):
        hint = f"commas stand between values: {key}=A,B"
        raise InputError(f"{key}={text} has an empty value", where=PLACE, hint=hint)
    return tuple(dict.fromkeys(items))


def _noise(text: str) -> tuple[float, ...]:
    items = _items("noise", text)
    if not all(map(NUMBER.match, items)):
        hint = "for example noise=0.01,0.05"
        raise InputError(f"noise={text} is no list of numbers", where=PLACE, hint=hint)
    return tuple(dict.fromkeys(map(float, items)))


def _numbers(key: str, text: str | None) -> tuple[int | None, ...]:
    items = _items(key, OWN_NUMBER if text is None else text)
    if not all(item == OWN_NUMBER or re.fullmatch(r"\d{1,4}", item) for item in items):
        hint = f"for example {key}=4,8 or {key}={OWN_NUMBER},4,8"
        raise InputError(f"{key}={text} is no list of whole numbers", where=PLACE, hint=hint)
    return tuple(dict.fromkeys(None if item == OWN_NUMBER else int(item) for item in items))


def _jobs(text: str) -> int:
    if not re.fullmatch(r"[1-9]\d{0,3}", text):
        raise InputError(
            f"jobs={text} is no number of processes", where=PLACE, hint="for example jobs=2"
        )
    return int(text)
