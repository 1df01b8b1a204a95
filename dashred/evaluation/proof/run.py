"""The proof from its first case to its document."""

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
from dashred.evaluation.proof.cases.descriptions import ended_in_words
from dashred.evaluation.proof.cases.draw import Case, draw_cases, seed_of
from dashred.evaluation.proof.cases.kept_case import RECORDING, Kept, folder_of, keep, read_done
from dashred.evaluation.proof.cases.kept_draw import keep_draw
from dashred.evaluation.proof.cases.record_case import RecordedCase, record_case
from dashred.evaluation.proof.isolation import LIMIT, Worker, WorkerLostError, isolated_copy, worker
from dashred.evaluation.proof.request import Request
from dashred.evaluation.proof.scoring.judge import unjudged
from dashred.evaluation.proof.scoring.score_case import score_case
from dashred.evaluation.twins.kept_seal import SEALED
from dashred.evaluation.twins.sealing import seal
from dashred.pipeline.run.output_dir import make_output

LOG = "log.txt"


def run_proof(request: Request) -> list[Kept]:
    """Run whatever is not done; returns what all cases leave, in order."""
    torch.set_num_threads(1)
    output = make_output(str(request.output))
    with lock_folder(output, "proof"), signals_as_interrupt():
        return _run(request, output)


def _run(request: Request, output: Path) -> list[Kept]:
    keep_draw(request)
    cases = draw_cases(seed_of(request.draw), request.cases, request.nulls)
    kept = {str(case): done for case in cases if (done := read_done(case, output))}
    waiting = [case for case in cases if str(case) not in kept]
    _say(f"{len(cases)} cases, {len(kept)} of them done already; in {output}")
    if waiting:
        with tempfile.TemporaryDirectory(prefix="dashred-worker-") as folder:
            desk = _Desk(request, isolated_copy(Path(folder)), kept, len(cases))
            desk.work_through(waiting)
    return [kept[str(case)] for case in cases]


class _Desk:
    """Hands cases to workers, and scores what comes back: one thing at a time, beside them."""

    def __init__(self, request: Request, copy: Path, kept: dict[str, Kept], total: int) -> None:
        self.request, self.copy, self.kept, self.total = request, copy, kept, total
        self.keeper, self.stopped = Lock(), Event()
        self.workers: set[Worker] = set()

    def work_through(self, waiting: Sequence[Case]) -> None:
        """Analyse every case, so many at once."""
        queue: SimpleQueue[Case] = SimpleQueue()
        for case in waiting:
            queue.put(case)
        jobs = min(self.request.jobs, len(waiting))
        with ThreadPoolExecutor(jobs) as pool:
            working = [pool.submit(self._empty, queue) for _ in range(jobs)]
            try:
                for done in as_completed(working):
                    done.result()
            except BaseException:
                # The pool waits for its threads, and these for their workers.
                self.stopped.set()
                for mine in list(self.workers):
                    mine.process.kill()
                raise

    def _empty(self, queue: SimpleQueue[Case]) -> None:
        while not (queue.empty() or self.stopped.is_set()):
            with worker(self.copy) as mine:
                self.workers.add(mine)
                try:
                    while not self.stopped.is_set():
                        self._finish(queue.get_nowait(), mine)
                except (WorkerLostError, Empty):
                    continue
                finally:
                    self.workers.discard(mine)

    def _finish(self, case: Case, mine: Worker) -> None:
        """See one case through, and keep its record: whatever goes wrong is part of it."""
        began = time.perf_counter()
        # An earlier try may have opened the seal of this very case.
        shutil.rmtree(folder_of(case, self.request.output), ignore_errors=True)
        recorded, problem, record = None, "", None
        with tempfile.TemporaryDirectory(prefix="dashred-recording-") as name:
            desk = Path(name)
            try:
                with self.keeper:
                    recorded = record_case(case, desk / RECORDING)
                words = self._words(recorded.case, desk)
                code, seconds = mine.analyse(words, desk / LOG, LIMIT)
                if code == DONE:
                    record = self._judged(recorded, desk, seconds)
                else:
                    problem = last_line(desk / LOG) or f"exit code {code}"
            except WorkerLostError as lost:
                if not self.stopped.is_set():
                    record = unjudged(case, None, f"the worker died: {lost}")
                    self._keep(case, recorded, record, desk, began)
                raise
            except Exception as error:  # The other cases have a right to their turn.
                (desk / "problem.txt").write_text(traceback.format_exc(), encoding="utf-8")
                problem = f"{type(error).__name__}: {error}"
            record = record or unjudged(case, None, problem)
            self._keep(case, recorded, record, desk, began)

    def _judged(self, recorded: RecordedCase, desk: Path, seconds: float) -> CaseRecord:
        """Seal the truth of a case whose findings are frozen; open it, and judge them."""
        with self.keeper:
            check_freeze(desk)
            seal(desk / SEALED, recorded.concealed.truth, recorded.concealed.system)
            return score_case(recorded, desk, seconds)

    def _words(self, case: Case, desk: Path) -> list[str]:
        """Return the words of the analysis: of the case it learns its recording alone.

        Where the numerics are at fault, the grid of its simulator, too: that is the user's to give.
        """
        return [
            f"conf={case.system}",
            *case.analysis_words,
            f"recording.path={desk / RECORDING}",
            f"output={desk}",
            f"tracking.root={self.copy / 'mlruns'}",
            "tracking.experiment=analysis",
            "tracking.model=false",
        ]

    def _keep(
        self,
        case: Case,
        recorded: RecordedCase | None,
        record: CaseRecord,
        desk: Path,
        began: float,
    ) -> None:
        """Move what a case left out of the workers' sight, its record last."""
        wall = time.perf_counter() - began
        shutil.copytree(desk, folder_of(case, self.request.output))
        kept = Kept(record, wall, 1 if recorded is None else recorded.draws)
        keep(case, self.request.output, kept)
        self.kept[str(case)] = kept
        _say(
            f"[{len(self.kept)}/{self.total}] {case} {case.system} {case.kind}: "
            f"{ended_in_words(record)}; {wall:.0f} s"
        )


def _say(text: str) -> None:
    CONSOLE.print(text, markup=False, soft_wrap=True)
