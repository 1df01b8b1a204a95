"""Run the cases of a proof: record, analyse, score."""

from __future__ import annotations

import shutil
import tempfile
import time
import traceback
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor, as_completed
from pathlib import Path
from queue import Empty, SimpleQueue
from threading import Event, Lock

import torch

from dashred.core.errors import DONE
from dashred.core.findings.findings import check_freeze
from dashred.core.job_control import last_line, lock_folder, signals_as_interrupt
from dashred.core.progress import CONSOLE
from dashred.evaluation.proof.cases.case_record import CaseRecord
from dashred.evaluation.proof.cases.case_store import (
    RECORDING,
    StoredCase,
    folder_of,
    read_finished,
    store_case,
)
from dashred.evaluation.proof.cases.descriptions import describe_outcome
from dashred.evaluation.proof.cases.draw import Case, draw_cases, seed_of
from dashred.evaluation.proof.cases.draw_file import write_draw
from dashred.evaluation.proof.cases.record_case import RecordedCase, record_case
from dashred.evaluation.proof.isolation import LIMIT, Worker, WorkerLostError, isolated_copy, worker
from dashred.evaluation.proof.request import Request
from dashred.evaluation.proof.scoring.judge import empty_record
from dashred.evaluation.proof.scoring.score_case import score_case
from dashred.evaluation.twins.seal_store import SEALED
from dashred.evaluation.twins.sealing import seal
from dashred.pipeline.run.output_dir import make_output

LOG = "log.txt"


def run_proof(request: Request) -> list[StoredCase]:
    """Run the unfinished cases; return the results of all cases in order."""
    torch.set_num_threads(1)
    output = make_output(str(request.output))
    with lock_folder(output, "proof"), signals_as_interrupt():
        return _run(request, output)


def _run(request: Request, output: Path) -> list[StoredCase]:
    write_draw(request)
    cases = draw_cases(seed_of(request.draw), request.cases, request.nulls)
    stored = {str(case): done for case in cases if (done := read_finished(case, output))}
    waiting = [case for case in cases if str(case) not in stored]
    _print(f"{len(cases)} cases, {len(stored)} of them already finished, in {output}")
    if waiting:
        with tempfile.TemporaryDirectory(prefix="dashred-worker-") as folder:
            runner = _Runner(request, isolated_copy(Path(folder)), stored, len(cases))
            runner.run_all(waiting)
    return [stored[str(case)] for case in cases]


class _Runner:
    """Passes cases to workers and scores their findings, one at a time, in this process."""

    def __init__(
        self, request: Request, copy: Path, stored: dict[str, StoredCase], total: int
    ) -> None:
        self.request, self.copy, self.stored, self.total = request, copy, stored, total
        self.lock, self.stopped = Lock(), Event()
        self.workers: set[Worker] = set()

    def run_all(self, waiting: Sequence[Case]) -> None:
        """Run all cases, several in parallel."""
        queue: SimpleQueue[Case] = SimpleQueue()
        for case in waiting:
            queue.put(case)
        jobs = min(self.request.jobs, len(waiting))
        with ThreadPoolExecutor(jobs) as pool:
            working = [pool.submit(self._work_on, queue) for _ in range(jobs)]
            try:
                for done in as_completed(working):
                    done.result()
            except BaseException:
                # The pool waits for its threads, and the threads wait for their workers.
                self.stopped.set()
                for current in list(self.workers):
                    current.process.kill()
                raise

    def _work_on(self, queue: SimpleQueue[Case]) -> None:
        while not (queue.empty() or self.stopped.is_set()):
            with worker(self.copy) as current:
                self.workers.add(current)
                try:
                    while not self.stopped.is_set():
                        self._run_case(queue.get_nowait(), current)
                except (WorkerLostError, Empty):
                    continue
                finally:
                    self.workers.discard(current)

    def _run_case(self, case: Case, current: Worker) -> None:
        """Run one case and store its record, which includes any failure."""
        started = time.perf_counter()
        # An earlier attempt may have opened the seal of this case.
        shutil.rmtree(folder_of(case, self.request.output), ignore_errors=True)
        recorded, problem, record = None, "", None
        with tempfile.TemporaryDirectory(prefix="dashred-recording-") as name:
            work_dir = Path(name)
            try:
                with self.lock:
                    recorded = record_case(case, work_dir / RECORDING)
                words = self._arguments(recorded.case, work_dir)
                code, seconds = current.analyse(words, work_dir / LOG, LIMIT)
                if code == DONE:
                    record = self._score(recorded, work_dir, seconds)
                else:
                    problem = last_line(work_dir / LOG) or f"exit code {code}"
            except WorkerLostError as lost:
                if not self.stopped.is_set():
                    record = empty_record(case, None, f"the worker died: {lost}")
                    self._store(case, recorded, record, work_dir, started)
                raise
            except Exception as error:  # One failure must not stop the other cases.
                (work_dir / "problem.txt").write_text(traceback.format_exc(), encoding="utf-8")
                problem = f"{type(error).__name__}: {error}"
            record = record or empty_record(case, None, problem)
            self._store(case, recorded, record, work_dir, started)

    def _score(self, recorded: RecordedCase, work_dir: Path, seconds: float) -> CaseRecord:
        """Seal the truth of a case with frozen findings, open it, and score them."""
        with self.lock:
            check_freeze(work_dir)
            seal(work_dir / SEALED, recorded.case_truth.truth, recorded.case_truth.system)
            return score_case(recorded, work_dir, seconds)

    def _arguments(self, case: Case, work_dir: Path) -> list[str]:
        """Return the arguments of the analysis: of the case only its recording.

        For unresolved numerics also the grid of the simulator, which the user chooses.
        """
        return [
            f"conf={case.system}",
            *case.analysis_words,
            f"recording.path={work_dir / RECORDING}",
            f"output={work_dir}",
            f"tracking.root={self.copy / 'mlruns'}",
            "tracking.experiment=analysis",
            "tracking.model=false",
        ]

    def _store(
        self,
        case: Case,
        recorded: RecordedCase | None,
        record: CaseRecord,
        work_dir: Path,
        started: float,
    ) -> None:
        """Copy the files of a case to the output folder, which workers cannot access."""
        wall = time.perf_counter() - started
        shutil.copytree(work_dir, folder_of(case, self.request.output))
        stored = StoredCase(record, wall, 1 if recorded is None else recorded.draws)
        store_case(case, self.request.output, stored)
        self.stored[str(case)] = stored
        _print(
            f"[{len(self.stored)}/{self.total}] {case} {case.system} {case.kind}: "
            f"{describe_outcome(record)}; {wall:.0f} s"
        )


def _print(text: str) -> None:
    CONSOLE.print(text, markup=False, soft_wrap=True)
