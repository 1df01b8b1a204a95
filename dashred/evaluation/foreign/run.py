"""Run the cases of a draw: make, analyse, freeze, score, store the row; then ask the peers."""

from __future__ import annotations

import shutil
import tempfile
import traceback
from collections.abc import Sequence
from functools import partial
from pathlib import Path
from threading import Event

from dashred.core.cluster.calls import NotAnsweredError
from dashred.core.findings.findings import write_json_atomic
from dashred.core.job_control import lock_folder, signals_as_interrupt
from dashred.core.progress import CONSOLE
from dashred.evaluation.foreign.arguments import Request
from dashred.evaluation.foreign.cases.case import Case, MadeCase
from dashred.evaluation.foreign.cases.case_files import CONFIG, write_case, write_truth
from dashred.evaluation.foreign.draw_file import DRAW, check_same_draw, describe_draw
from dashred.evaluation.foreign.make_case import make_case
from dashred.evaluation.foreign.peers.ask import ask_peers, is_asked
from dashred.evaluation.foreign.plan import chosen
from dashred.evaluation.foreign.rows import Row, is_done, read_row, write_row
from dashred.evaluation.foreign.score_case import empty_row, score_case
from dashred.evaluation.isolation.analysis import FOUND, GIVEN, LOG, Analysis
from dashred.evaluation.isolation.analysts import Analysts, open_analysts
from dashred.evaluation.side_by_side import run_all
from dashred.pipeline.run.output_dir import make_output

FOLDERS = ("rows", "analyses", "truths")


def run_foreign(request: Request, cases: Sequence[Case]) -> list[Row]:
    """Run the chosen cases that are not done; return the rows of all chosen cases.

    Args:
        request: settings.
        cases: the complete draw.
    """
    output = make_output(str(request.output))
    for name in FOLDERS:
        (output / name).mkdir(exist_ok=True)
    with lock_folder(output, "foreign"), signals_as_interrupt():
        draw = describe_draw(request, cases)
        check_same_draw(output, draw)
        write_json_atomic(output / DRAW, draw)
        wanted = chosen(request, cases)
        waiting = [case for case in wanted if not is_done(output, case)]
        done = len(wanted) - len(waiting)
        _print(f"{len(wanted)} of {len(cases)} cases, {done} of them done, in {output}")
        if waiting:
            _analyse_cases(request, waiting)
        if request.peer_limit:
            _ask_about(request, wanted)
        return [row for case in wanted if (row := read_row(output, case)) is not None]


def _analyse_cases(request: Request, waiting: Sequence[Case]) -> None:
    with open_analysts(request.cluster, request.jobs) as analysts:
        run = partial(_run_case, request.output, float(request.limit), analysts)
        run_all(run, waiting, analysts.count, _Progress(len(waiting)), analysts.stop)


def _ask_about(request: Request, wanted: Sequence[Case]) -> None:
    """Ask the peers about the cases that were analysed, and that they have not been asked about."""
    rows = {case: read_row(request.output, case) for case in wanted if is_asked(case)}
    unasked = [case for case, row in rows.items() if row is not None and not row["peers"]]
    if unasked:
        _print(f"asking other methods about {len(unasked)} cases")
        stopped = Event()
        ask = partial(_ask, request.output, request.peer_limit, stopped)
        run_all(ask, unasked, request.jobs, _Progress(len(unasked)), stopped.set)


class _Progress:
    """Print a line for each row."""

    def __init__(self, total: int) -> None:
        self.total, self.done = total, 0

    def __call__(self, row: Row | None) -> None:
        """Print the line of a row; None is a case that has none."""
        self.done += 1
        if row is not None:
            _print(f"[{self.done}/{self.total}] {_line(row)}")


def _run_case(output: Path, limit: float, analysts: Analysts, case: Case) -> Row:
    """Run one case and store its row; a failure is a row without an answer.

    The truth is in the memory of this process until the findings are frozen.
    """
    with tempfile.TemporaryDirectory(prefix="dashred-foreign-") as name:
        work_dir = Path(name)
        made: MadeCase | None = None
        try:
            made = make_case(case)
            row = _answer(case, made, work_dir, limit, analysts)
        except NotAnsweredError:
            raise
        except Exception as error:  # One failure must not stop the other cases.
            (work_dir / "problem.txt").write_text(traceback.format_exc(), encoding="utf-8")
            truth = None if made is None else made.truth
            row = empty_row(case, truth, f"{type(error).__name__}: {error}"[:300])
        shutil.rmtree(output / "analyses" / case.name, ignore_errors=True)
        shutil.copytree(work_dir, output / "analyses" / case.name)
        if made is not None:
            write_truth(output / "truths" / f"{case.name}.json", made.truth)
        write_row(output, case, row)
        return row


def _answer(case: Case, made: MadeCase, work_dir: Path, limit: float, analysts: Analysts) -> Row:
    """Return the row of the analysis, whose process sees the files of the case alone."""
    given, found = work_dir / "case", work_dir / "findings"
    given.mkdir()
    write_case(given, made)
    files = {path.name: path.read_bytes() for path in given.iterdir()}
    words = (
        f"conf={GIVEN}/{CONFIG}",
        f"output={FOUND}",
        f"seed={case.analysis_seed}",
        "threads=1",
    )
    answer = analysts.analyse(Analysis(files, words, limit))
    answer.write(found, work_dir / LOG)
    if answer.problem is None:
        row = score_case(case, made.truth, given, found)
    else:
        row = empty_row(case, made.truth, answer.problem)
    row["seconds"], row["wall"] = answer.seconds, answer.wall
    return row


def _ask(output: Path, limit: float, stopped: Event, case: Case) -> Row | None:
    """Ask the peers about one case and add their answers to its row."""
    row = read_row(output, case)
    if row is None or stopped.is_set():
        return None
    try:
        made = make_case(case)
    except Exception as error:  # As for the analysis: its row tells why there is no case.
        _print(f"{case.name}: {type(error).__name__}: {error}"[:300])
        return None
    row["peers"] = ask_peers(case, made, limit)
    if stopped.is_set():
        return None
    write_row(output, case, row)
    return row


def _line(row: Row) -> str:
    peers = ", ".join(
        f"{name}: {'right' if peer['right'] else 'wrong' if peer['right'] is False else 'none'}"
        for name, peer in row["peers"].items()
    )
    told = row["problem"] or row["told"]
    return (
        f"{row['case']}: {row['outcome']}, {row['wall']:.0f} s; hidden: {row['hidden']}; "
        f"found: {told}; {peers}"
    )


def _print(text: str) -> None:
    CONSOLE.print(text, markup=False, soft_wrap=True)
