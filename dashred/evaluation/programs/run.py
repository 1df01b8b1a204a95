"""Run the rows: record a twin, analyse it with equations and as a program, score both."""

from __future__ import annotations

import shutil
import tempfile
import time
from collections.abc import Sequence
from functools import partial
from pathlib import Path

import numpy as np

from dashred.config import load_config
from dashred.core.errors import DONE
from dashred.core.job_control import last_line
from dashred.evaluation.case_rows import Case, run_cases
from dashred.evaluation.isolation.worker import (
    WorkerLostError,
    isolated_copy,
    store_words,
    worker,
)
from dashred.evaluation.programs import bundled_steps
from dashred.evaluation.programs.arguments import BENCHMARK, Request
from dashred.evaluation.programs.hidden_equations import STEPS, hide_equations
from dashred.evaluation.programs.rows import Answer, Row
from dashred.evaluation.programs.score_answer import score_answer
from dashred.evaluation.twins.record_command import record
from dashred.evaluation.twins.sealing import Truth, open_seal
from dashred.pipeline.run.output_dir import make_output

NOISE = 0.01
RECORDING, SEALED, LOG = "recording.nc", "sealed.nc", "log.txt"
FOLDERS = ("analyses", "truths")


def run_programs(request: Request) -> None:
    """Run the rows of a request that are not done."""
    output = make_output(str(request.output))
    for name in FOLDERS:
        (output / name).mkdir(exist_ok=True)
    with tempfile.TemporaryDirectory(prefix="dashred-worker-") as folder:
        copy = isolated_copy(Path(folder))
        shutil.copy(bundled_steps.__file__, copy / f"{STEPS}.py")
        run_cases(request, output, BENCHMARK, partial(_run_case, request, copy), _told)


def _run_case(request: Request, copy: Path, case: Case) -> Row:
    """Return the row of a case.

    The truth is in the memory of this process until the findings are frozen.
    """
    work_dir = request.output / "analyses" / case.name
    shutil.rmtree(work_dir, ignore_errors=True)
    words = [f"conf={case.system}", f"recording.twin={case.twin}", f"recording.noise={NOISE:g}"]
    record(load_config([*words, f"seed={case.seed}"], entry="record"), work_dir)
    sealed = (work_dir / SEALED).read_bytes()
    truth, _ = open_seal(work_dir / SEALED)
    (work_dir / SEALED).unlink()
    recording = work_dir / RECORDING
    by_equations = [f"conf={case.system}", f"recording.path={recording}"]
    equations = _analyse(request, copy, case, truth, work_dir / "equations", by_equations)
    hidden = work_dir / f"{case.system}.yaml"
    by_program = [f"conf={hidden}", f"trust={hide_equations(case.system, recording, hidden)}"]
    tally = copy / bundled_steps.TALLY
    tally.unlink(missing_ok=True)
    program = _analyse(request, copy, case, truth, work_dir / "program", by_program)
    calls, states, seconds = np.fromfile(tally).tolist() if tally.is_file() else (0, 0, 0.0)
    (request.output / "truths" / f"{case.name}.nc").write_bytes(sealed)
    return Row(
        system=case.system,
        twin=case.twin,
        seed=case.seed,
        budget=request.budget,
        equations=equations,
        program=program,
        calls=int(calls),
        states=int(states),
        seconds_inside=seconds,
    )


def _analyse(
    request: Request, copy: Path, case: Case, truth: Truth, folder: Path, own: Sequence[str]
) -> Answer:
    """Return the answer of an analysis in a process of its own, which sees the recording alone."""
    folder.mkdir()
    found, log = folder / "findings", folder / LOG
    words = [
        *own,
        f"output={found}",
        f"seed={case.seed}",
        "threads=1",
        *store_words(copy),
    ]
    if request.budget is not None:
        words.append(f"budget={request.budget}")
    began = time.perf_counter()
    try:
        with worker(copy) as current:
            code, seconds = current.analyse(words, log, float(request.limit))
    except WorkerLostError as lost:
        return _no_answer(time.perf_counter() - began, f"the process was ended: {lost}")
    if code != DONE:
        return _no_answer(seconds, last_line(log) or f"exit code {code}")
    return score_answer(found, truth, seconds)


def _no_answer(seconds: float, problem: str) -> Answer:
    return Answer(
        verdict=None, exact=None, error=None, deviation=None, seconds=seconds, problem=problem
    )


def _told(row: Row) -> str:
    program, equations = row["program"], row["equations"]
    exact = {True: "exact", False: "not exact", None: "no law"}[program["exact"]]
    return (
        f"{program['problem'] or program['verdict']}, {exact}, {row['calls']} calls, "
        f"{program['seconds']:.0f} s; with equations {equations['seconds']:.0f} s"
    )
