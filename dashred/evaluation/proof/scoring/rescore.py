"""Score a kept draw again: its analyses stay as they were frozen, the scorer is this commit's."""

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
from dashred.evaluation.proof.cases.descriptions import ended_in_words
from dashred.evaluation.proof.cases.draw import Case, draw_cases, seed_of
from dashred.evaluation.proof.cases.kept_case import RECORDING, Kept, folder_of, keep, read_kept
from dashred.evaluation.proof.cases.record_case import record_case
from dashred.evaluation.proof.request import Request
from dashred.evaluation.proof.scoring.score_case import score_case


def rescore(request: Request) -> list[Kept]:
    """Score all cases of a draw again that this commit has not scored; returns what they leave.

    Raises:
        InputError: a case is not finished, is not what was drawn, was recorded by other code, or
            its findings are not those that were frozen.
    """
    cases = draw_cases(seed_of(request.draw), request.cases, request.nulls)
    with lock_folder(request.output, "proof"), signals_as_interrupt():
        return list(_scored(request, cases))


def _scored(request: Request, cases: list[Case]) -> Iterator[Kept]:
    # Threads of torch do not outlive a fork.
    with ProcessPoolExecutor(
        request.jobs, get_context("spawn"), torch.set_num_threads, (1,)
    ) as pool:
        score = partial(score_again, output=request.output, commit=request.scored_by)
        for number, (case, kept) in enumerate(zip(cases, pool.map(score, cases), strict=True), 1):
            ended = ended_in_words(kept.record)
            text = f"[{number}/{len(cases)}] {case} {case.system} {case.kind}: {ended}"
            CONSOLE.print(text, markup=False, soft_wrap=True)
            yield kept


def score_again(case: Case, output: Path, commit: str | None) -> Kept:
    """Score one case again, unless this commit has, or it died; returns what it leaves.

    Raises:
        InputError: as :func:`rescore`.
    """
    folder, kept = folder_of(case, output), read_kept(case, output)
    if kept is None:
        hint = "finish the draw first, with the command that began it"
        raise InputError("no finished case of this draw", where=str(folder), hint=hint)
    if kept.scored_by == commit or kept.record["problem"] is not None:
        return kept
    check_freeze(folder)
    with tempfile.TemporaryDirectory(prefix="dashred-scorer-") as name:
        again = Path(name) / RECORDING
        recorded = record_case(case, again)
        if sha256_of(again) != sha256_of(folder / RECORDING):
            hint = "score it with the code, and on a machine like that, which recorded it"
            what = "this commit records another truth than the one that was analysed"
            raise InputError(what, where=str(folder / RECORDING), hint=hint)
    record = score_case(recorded, folder, kept.record["seconds"])
    kept = replace(kept, record=record, scored_by=commit)
    keep(case, output, kept)
    return kept
