"""Tables of twins of bundled systems: the words that choose the cases, and a file for each row."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import product
from pathlib import Path
from typing import Any, TypeVar

from dashred.config.bundled_systems import (
    bundled_names,
    check_checkout,
    read_bundled_name,
    results_root,
)
from dashred.core.command_line.argument_types import (
    integer_reader,
    list_reader,
    ranges_reader,
    read_absolute_path,
)
from dashred.core.command_line.arguments import COMMAND_LINE, HELP_FLAGS, Command, argument
from dashred.core.errors import InputError, nearest
from dashred.core.findings.findings import write_json_atomic
from dashred.core.job_control import lock_folder, signals_as_interrupt
from dashred.core.progress import CONSOLE
from dashred.evaluation.json_lines import write_page
from dashred.pipeline.run.output_dir import make_output

ROWS = "rows"
ACTIONS = ("run", "document")


@dataclass(frozen=True, kw_only=True)
class CaseRequest:
    """The cases of a command, and what each analysis may take.

    Attributes:
        action: run or document.
    """

    systems: tuple[str, ...] = argument(
        list_reader(read_bundled_name),
        "wave,rde",
        "bundled systems",
        default=",".join(bundled_names()),
    )
    twins: tuple[str, ...] = argument(
        list_reader(str), "a,b", "hidden truths of each system", default="a"
    )
    seeds: tuple[int, ...] = argument(
        ranges_reader(at_most=10_000), "0-4", "a range, or a list such as 0,1,3", default="0"
    )
    limit: int = argument(
        integer_reader(at_least=1, at_most=100_000),
        "1200",
        "seconds after which an analysis is ended: no answer",
        default="1200",
    )
    budget: int | None = argument(
        integer_reader(at_least=1, at_most=100_000),
        "1800",
        "seconds on the clock that each analysis may take; default: as for any analysis",
        default=None,
    )
    action: str = ""


def output_argument(benchmark: str) -> Any:
    """Declare the folder of the rows of a table."""
    folder = results_root() / benchmark
    return argument(
        read_absolute_path,
        "DIR",
        f"default: {folder} (not tracked by git)",
        factory=lambda: results_root() / benchmark,
    )


def page_argument(benchmark: str) -> Any:
    """Declare the page of a table."""
    default = str(results_root() / f"docs/{benchmark}.md")
    return argument(read_absolute_path, "FILE", "the page", default=default)


Requested = TypeVar("Requested", bound=CaseRequest)


@dataclass(frozen=True)
class Case:
    """A twin of a bundled system, and its seed."""

    system: str
    twin: str
    seed: int

    @property
    def name(self) -> str:
        """Name of its files."""
        return f"{self.system}-{self.twin}-{self.seed}"


def read_action(command: Command[Requested], argv: list[str]) -> Requested:
    """Read ``BENCHMARK run|document [key=value ...]``; ``--help`` prints the usage and ends.

    Raises:
        InputError: an unknown word, or a value that cannot be read.
    """
    if HELP_FLAGS & set(argv):
        command.read(["--help"])
    action, *rest = argv[1:] or [""]
    if action not in ACTIONS:
        fault = f"there is no action {action!r}" if action else "which action?"
        raise InputError(fault, where=COMMAND_LINE, hint=nearest(action, ACTIONS))
    words = command.read(rest)
    check_checkout("the evaluation is run")
    return replace(words, action=action)


def cases_of(request: CaseRequest) -> list[Case]:
    """Return the cases of a request."""
    return [Case(*each) for each in product(request.systems, request.twins, request.seeds)]


def is_done(output: Path, case: Case) -> bool:
    """Return whether a case has a row."""
    return _path(output, case).is_file()


def read_rows(output: Path) -> list[Any]:
    """Return all rows of a folder, by name and seed.

    Raises:
        InputError: there are none.
    """
    paths = (output / ROWS).glob("*.json")
    rows = [json.loads(path.read_text(encoding="utf-8")) for path in paths]
    if not rows:
        hint = "the action `run` of this command writes them"
        raise InputError("there are no rows", where=str(output), hint=hint)
    return sorted(rows, key=lambda row: (row["system"], row["twin"], row["seed"]))


def write_table(output: Path, page: Path, document: Callable[[Sequence[Any]], str]) -> None:
    """Write the page of all rows of a folder, and the rows beside it as JSON lines.

    Args:
        output: folder of the rows.
        page: the page.
        document: returns the page of rows as Markdown.

    Raises:
        InputError: there are no rows.
    """
    rows = read_rows(output)
    write_page(page, document(rows), rows)


def run_cases(
    request: CaseRequest,
    output: Path,
    benchmark: str,
    run_case: Callable[[Case], Mapping[str, Any]],
    told: Callable[[Any], str],
) -> None:
    """Run the cases of a request that have no row.

    Args:
        request: with the cases.
        output: folder of the rows.
        benchmark: name of the table.
        run_case: returns the row of a case.
        told: returns a row on one line.
    """
    (make_output(str(output)) / ROWS).mkdir(exist_ok=True)
    with lock_folder(output, benchmark), signals_as_interrupt():
        cases = cases_of(request)
        waiting = [case for case in cases if not is_done(output, case)]
        _say(f"{len(cases)} rows, {len(cases) - len(waiting)} of them done, in {output}")
        for case in waiting:
            row = run_case(case)
            write_json_atomic(_path(output, case), row)
            _say(f"{case.name}: {told(row)}")


def _say(text: str) -> None:
    """Print one line as it is."""
    CONSOLE.print(text, markup=False, soft_wrap=True)


def _path(output: Path, case: Case) -> Path:
    return output / ROWS / f"{case.name}.json"
