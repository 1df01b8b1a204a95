"""Rescore a finished draw: its frozen findings are unchanged, the scorer is the current one."""

from __future__ import annotations

import tempfile
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from functools import partial
from multiprocessing import get_context
from pathlib import Path

import torch

from dashred.core.errors import InputError
from dashred.core.findings.findings import check_freeze, sha256_of
from dashred.core.job_control import lock_folder, signals_as_interrupt
from dashred.core.progress import CONSOLE
from dashred.evaluation.proof.cases.case_store import (
    RECORDING,
    StoredCase,
    folder_of,
    read_case,
    store_case,
)
from dashred.evaluation.proof.cases.descriptions import describe_outcome
from dashred.evaluation.proof.cases.draw import Case, draw_cases, seed_of
from dashred.evaluation.proof.cases.record_case import record_case
from dashred.evaluation.proof.request import Request
from dashred.evaluation.proof.scoring.score_case import score_case


def rescore(request: Request) -> list[StoredCase]:
    """Rescore the cases that this commit has not scored; return all results.

    Raises:
        InputError: a case is unfinished, does not match the draw, or was recorded by other code, or
            its findings have changed since they were frozen.
    """
    cases = draw_cases(seed_of(request.draw), request.cases, request.nulls)
    with lock_folder(request.output, "proof"), signals_as_interrupt():
        return list(_scored(request, cases))


def _scored(request: Request, cases: list[Case]) -> Iterator[StoredCase]:
    # Threads of torch do not survive a fork.
    with ProcessPoolExecutor(
        request.jobs, get_context("spawn"), torch.set_num_threads, (1,)
    ) as pool:
        score = partial(rescore_case, output=request.output, commit=request.scored_by)
        for number, (case, stored) in enumerate(zip(cases, pool.map(score, cases), strict=True), 1):
            ended = describe_outcome(stored.record)
            text = f"[{number}/{len(cases)}] {case} {case.system} {case.kind}: {ended}"
            CONSOLE.print(text, markup=False, soft_wrap=True)
            yield stored


def rescore_case(case: Case, output: Path, commit: str | None) -> StoredCase:
    """Rescore one case, unless this commit has scored it or it failed; return its result.

    Raises:
        InputError: as :func:`rescore`.
    """
    folder, stored = folder_of(case, output), read_case(case, output)
    if stored is None:
        hint = "finish the draw first, with its original command"
        raise InputError("this case of the draw is not finished", where=str(folder), hint=hint)
    if stored.scored_by == commit or stored.record["problem"] is not None:
        return stored
    check_freeze(folder)
    with tempfile.TemporaryDirectory(prefix="dashred-scorer-") as name:
        again = Path(name) / RECORDING
        recorded = record_case(case, again)
        if sha256_of(again) != sha256_of(folder / RECORDING):
            hint = "score it with the code and on the kind of machine that recorded it"
            what = "this commit gives another recording than the one that was analysed"
            raise InputError(what, where=str(folder / RECORDING), hint=hint)
    record = score_case(recorded, folder, stored.record["seconds"])
    stored = replace(stored, record=record, scored_by=commit)
    store_case(case, output, stored)
    return stored
