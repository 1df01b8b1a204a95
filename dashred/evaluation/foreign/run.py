"""Run the cases of a draw: make, analyse, freeze, score, store the row; then ask the peers."""

from __future__ import annotations

import shutil
import tempfile
import time
import traceback
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor, as_completed
from functools import partial
from pathlib import Path
from threading import Event

from dashred.core.errors import DONE
from dashred.core.findings.findings import write_json_atomic
from dashred.core.job_control import last_line, lock_folder, signals_as_interrupt
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
from dashred.evaluation.proof.isolation import Worker, WorkerLostError, isolated_copy, worker
from dashred.pipeline.run.output_dir import make_output

LOG = "log.txt"
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
            with tempfile.TemporaryDirectory(prefix="dashred-worker-") as folder:
                copy, runner = isolated_copy(Path(folder)), _Runner(request)
                runner.run_all(partial(runner.analyse, copy), waiting)
        if request.peer_limit:
            _ask_about(request, wanted)
        return [row for case in wanted if (row := read_row(output, case)) is not None]


def _ask_about(request: Request, wanted: Sequence[Case]) -> None:
    """Ask the peers about the cases that were analysed, and that they have not been asked about."""
    rows = {case: read_row(request.output, case) for case in wanted if is_asked(case)}
    unasked = [case for case, row in rows.items() if row is not None and not row["peers"]]
    if unasked:
        _print(f"asking other methods about {len(unasked)} cases")
        runner = _Runner(request)
        runner.run_all(runner.ask, unasked)


class _Runner:
    """Runs cases in threads, each of which waits for the processes of one case at a time."""

    def __init__(self, request: Request) -> None:
        self.request = request
        self.stopped = Event()
        self.workers: set[Worker] = set()

    def run_all(self, run: Callable[[Case], Row | None], waiting: Sequence[Case]) -> None:
        """Run something for all cases; on an exception, stop their processes."""
        with ThreadPoolExecutor(min(self.request.jobs, len(waiting))) as pool:
            try:
                for number, done in enumerate(
                    as_completed([pool.submit(run, case) for case in waiting]), 1
                ):
                    if (row := done.result()) is not None:
                        _print(f"[{number}/{len(waiting)}] {_line(row)}")
            except BaseException:
                # The pool waits for its threads, and the threads wait for their processes.
                self.stopped.set()
                pool.shutdown(wait=False, cancel_futures=True)
                for current in list(self.workers):
                    current.process.kill()
                raise

    def analyse(self, copy: Path, case: Case) -> Row | None:
        """Run one case and store its row; a failure is a row without an answer."""
        with tempfile.TemporaryDirectory(prefix="dashred-foreign-") as name:
            work_dir = Path(name)
            made: MadeCase | None = None
            try:
                made = make_case(case)
                row = self._answer(copy, case, made, work_dir)
            except Exception as error:  # One failure must not stop the other cases.
                (work_dir / "problem.txt").write_text(traceback.format_exc(), encoding="utf-8")
                truth = None if made is None else made.truth
                row = empty_row(case, truth, f"{type(error).__name__}: {error}"[:300])
            if self.stopped.is_set():
                return None
            output = self.request.output
            shutil.rmtree(output / "analyses" / case.name, ignore_errors=True)
            shutil.copytree(work_dir, output / "analyses" / case.name)
            if made is not None:
                write_truth(output / "truths" / f"{case.name}.json", made.truth)
            write_row(output, case, row)
            return row

    def ask(self, case: Case) -> Row | None:
        """Ask the peers about one case and add their answers to its row."""
        row = read_row(self.request.output, case)
        if row is None or self.stopped.is_set():
            return None
        try:
            made = make_case(case)
        except Exception as error:  # As for the analysis: its row tells why there is no case.
            _print(f"{case.name}: {type(error).__name__}: {error}"[:300])
            return None
        row["peers"] = ask_peers(case, made, self.request.peer_limit)
        if self.stopped.is_set():
            return None
        write_row(self.request.output, case, row)
        return row

    def _answer(self, copy: Path, case: Case, made: MadeCase, work_dir: Path) -> Row:
        """Return the row of the analysis, whose process sees the files of the case alone.

        The truth is in the memory of this process until the findings are frozen.
        """
        given, found = work_dir / "case", work_dir / "findings"
        given.mkdir()
        write_case(given, made)
        words = [
            f"conf={given / CONFIG}",
            f"output={found}",
            f"seed={case.analysis_seed}",
            "threads=1",
            f"tracking.root={copy / 'mlruns'}",
            "tracking.experiment=analysis",
            "tracking.model=false",
        ]
        began, limit = time.perf_counter(), float(self.request.limit)
        try:
            with worker(copy) as current:
                self.workers.add(current)
                try:
                    code, seconds = current.analyse(words, work_dir / LOG, limit)
                finally:
                    self.workers.discard(current)
        except WorkerLostError as lost:
            wall = time.perf_counter() - began
            late = wall >= limit
            problem = f"no answer within {limit:g} s" if late else f"the process died: {lost}"
            row = empty_row(case, made.truth, problem)
            row["seconds"], row["wall"] = wall, wall
            return row
        wall = time.perf_counter() - began
        if code == DONE:
            row = score_case(case, made.truth, given, found)
        else:
            problem = last_line(work_dir / LOG) or f"exit code {code}"
            row = empty_row(case, made.truth, problem)
        row["seconds"], row["wall"] = seconds, wall
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
