"""Run the cases of a proof: record, analyse, score."""

from __future__ import annotations

import shutil
import tempfile
import time
import traceback
from pathlib import Path
from threading import Lock

import torch

from dashred.core.cluster.calls import NotAnsweredError
from dashred.core.findings.findings import check_freeze
from dashred.core.job_control import lock_folder, signals_as_interrupt
from dashred.core.progress import CONSOLE
from dashred.evaluation.isolation.analysis import FOUND, GIVEN, LOG, Analysis
from dashred.evaluation.isolation.analysts import Analysts, open_analysts
from dashred.evaluation.isolation.worker import LIMIT
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
from dashred.evaluation.proof.request import Request
from dashred.evaluation.proof.scoring.judge import empty_record
from dashred.evaluation.proof.scoring.score_case import score_case
from dashred.evaluation.side_by_side import run_all
from dashred.evaluation.twins.seal_store import SEALED
from dashred.evaluation.twins.sealing import seal
from dashred.pipeline.run.output_dir import make_output


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
        with open_analysts(request.cluster, request.jobs) as analysts:
            runner = _Runner(request, analysts, stored, len(cases))
            run_all(runner.run, waiting, analysts.count, runner.print_line, analysts.stop)
    return [stored[str(case)] for case in cases]


class _Runner:
    """Records cases, has them analysed, and scores the findings, one at a time."""

    def __init__(
        self, request: Request, analysts: Analysts, stored: dict[str, StoredCase], total: int
    ) -> None:
        self.request, self.analysts, self.stored, self.total = request, analysts, stored, total
        self.lock = Lock()

    def run(self, case: Case) -> Case:
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
                answer = self.analysts.analyse(_analysis(recorded.case, work_dir / RECORDING))
                answer.write(work_dir, work_dir / LOG)
                if answer.problem is None:
                    record = self._score(recorded, work_dir, answer.seconds)
                else:
                    problem = answer.problem
            except NotAnsweredError:
                raise
            except Exception as error:  # One failure must not stop the other cases.
                (work_dir / "problem.txt").write_text(traceback.format_exc(), encoding="utf-8")
                problem = f"{type(error).__name__}: {error}"
            record = record or empty_record(case, None, problem)
            wall = time.perf_counter() - started
            shutil.copytree(work_dir, folder_of(case, self.request.output))
        stored = StoredCase(record, wall, 1 if recorded is None else recorded.draws)
        store_case(case, self.request.output, stored)
        self.stored[str(case)] = stored
        return case

    def print_line(self, case: Case) -> None:
        """Print how a case has ended."""
        done = self.stored[str(case)]
        _print(
            f"[{len(self.stored)}/{self.total}] {case} {case.system} {case.kind}: "
            f"{describe_outcome(done.record)}; {done.wall:.0f} s"
        )

    def _score(self, recorded: RecordedCase, work_dir: Path, seconds: float) -> CaseRecord:
        """Seal the truth of a case with frozen findings, open it, and score them."""
        with self.lock:
            check_freeze(work_dir)
            seal(work_dir / SEALED, recorded.case_truth.truth, recorded.case_truth.system)
            return score_case(recorded, work_dir, seconds)


def _analysis(case: Case, recording: Path) -> Analysis:
    """Return the analysis of a case: it is told its recording alone.

    For unresolved numerics also the grid of the simulator, which the user chooses.
    """
    words = (
        f"conf={case.system}",
        *case.analysis_words,
        f"recording.path={GIVEN}/{RECORDING}",
        f"output={FOUND}",
    )
    return Analysis({RECORDING: recording.read_bytes()}, words, LIMIT)


def _print(text: str) -> None:
    CONSOLE.print(text, markup=False, soft_wrap=True)
