"""Follow a stream with the results of a run: ``dashred follow run=RUNDIR source=SOURCE``."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from dashred.core.command_line.argument_types import (
    integer_reader,
    list_reader,
    read_number,
    read_path,
)
from dashred.core.command_line.arguments import COMMAND_LINE, Command, argument
from dashred.core.errors import DONE, InputError

SMALLEST_RATE, LARGEST_RATE = 1e-7, 0.05


def _read_rate(text: str) -> float:
    """Read a rate of false alarms per sample."""
    rate = read_number(text)
    if not SMALLEST_RATE <= rate <= LARGEST_RATE:
        raise ValueError(f"{text} is not between {SMALLEST_RATE:g} and {LARGEST_RATE:g}")
    return rate


def _read_seconds(text: str) -> float:
    """Read a number of seconds."""
    seconds = read_number(text)
    if seconds < 0:
        raise ValueError(f"{text} is negative")
    return seconds


@dataclass(frozen=True, kw_only=True)
class Arguments:
    """Arguments of the command."""

    run: Path = argument(read_path, "RUNDIR", "output folder of a finished run")
    source: str | None = argument(
        str,
        "SOURCE",
        "FILE.csv that grows, - for standard input, mqtt://HOST:PORT/TOPIC or ws://HOST:PORT/PATH. "
        "A CSV has a column `time` and one for each sensor and input; a message of JSON is "
        '{"time": 1.5, "SENSOR": 0.2}',
        default=None,
    )
    output: Path | None = argument(
        read_path,
        "FILE.csv",
        "estimates, one row for each sample, as CSV or, with the ending .jsonl, as lines of JSON; "
        "default: standard output",
        default=None,
    )
    at: tuple[str, ...] | None = argument(
        list_reader(str),
        "u@1.5,...",
        "further quantities to estimate: FIELD@PLACE, or a field of a system without axes",
        default=None,
    )
    ahead: int = argument(
        integer_reader(at_least=1, at_most=100_000), "10", "steps of the forecast", default="10"
    )
    alarm: float = argument(
        _read_rate,
        "1e-4",
        "rate of false alarms per sample, of all charts together",
        default="1e-4",
    )
    members: int | None = argument(
        integer_reader(at_least=4, at_most=10_000),
        "40",
        "members of an ensemble filter; default: an observer",
        default=None,
    )
    fields: Path | None = argument(
        read_path, "FILE.zarr", "whole fields at intervals, to Zarr or NetCDF (.nc)", default=None
    )
    every: int = argument(
        integer_reader(at_least=1), "100", "samples between two fields", default="100"
    )
    window: Path | None = argument(
        read_path,
        "NAME",
        "where the samples since an alarm are written: NAME-1.csv, NAME-2.csv, …; default: the "
        "name of the output with -window",
        default=None,
    )
    idle: float | None = argument(
        _read_seconds,
        "60",
        "end after so many seconds without a message; default: never",
        default=None,
    )
    export: Path | None = argument(
        read_path,
        "FILE.pt2",
        "write the corrected SHRED as a graph of torch.export, which torch alone loads",
        default=None,
    )
    seed: int = argument(integer_reader(), "0", "seed of the random numbers", default="0")
    trust: str | None = argument(
        str, "NAME", "program that is the simulator, whose code may run", default=None
    )


COMMAND = Command(
    "dashred follow",
    Arguments,
    """\
Follows a stream of readings with the results of a finished run. For every sample it writes the
estimates of an observer on the corrected simulator and of the corrected SHRED, the
innovations and a forecast. It raises an alarm as soon as the innovations are no longer white noise.
Ctrl-C ends it.""",
    after="See docs/follow.md.",
)


def main(argv: list[str]) -> int:
    """Follow a stream until it ends."""
    words = COMMAND.read(argv)
    if words.source is None and words.export is None:
        hint = "source=FILE.csv, or export=FILE.pt2 without a source"
        raise InputError("source= is missing", where=COMMAND_LINE, hint=hint)
    _check_places(words)
    # Imported here because torch takes seconds to import, and input errors should appear at once.
    from dashred.models.torch_setup import set_up_torch
    from dashred.pipeline.follow.finished_run import read_run
    from dashred.pipeline.follow.session import Settings, follow

    set_up_torch(1)
    run = read_run(words.run, words.trust)
    if words.export is not None:
        from dashred.pipeline.follow.export import export_surrogate

        export_surrogate(words.export, run)
    if words.source is not None:
        settings = Settings(
            source=words.source,
            output=words.output,
            at=words.at or (),
            ahead=words.ahead,
            rate=words.alarm,
            members=words.members,
            fields=words.fields,
            every=words.every,
            window=words.window or _window(words.output),
            idle=words.idle,
            seed=words.seed,
        )
        follow(run, settings)
    return DONE


def _window(output: Path | None) -> Path:
    return Path("follow-window") if output is None else output.with_name(f"{output.stem}-window")


def _check_places(words: Arguments) -> None:
    """Check the places of input and output before anything is imported."""
    from dashred.pipeline.follow.output_paths import check_ending, check_new
    from dashred.pipeline.follow.sources.open_source import check_source

    check_new(words.output, "output")
    check_new(words.fields, "fields")
    check_new(words.export, "export")
    check_ending(words.fields)
    if words.source is not None:
        check_source(words.source)
