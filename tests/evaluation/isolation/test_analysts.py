"""Analyses on this machine and on a cluster give the same answers."""

from __future__ import annotations

import threading
import time
from collections.abc import Iterator

import pytest

from dashred.core.cluster.calls import NotAnsweredError
from dashred.core.cluster.word import Cluster
from dashred.evaluation.isolation import analysts as module
from dashred.evaluation.isolation.analysis import FOUND, GIVEN, Analysis, analyse
from dashred.evaluation.isolation.analysts import Analysts, LocalAnalysts, open_analysts
from dashred.evaluation.side_by_side import run_all
from tests.evaluation.isolation.dying import die_always, die_once

WRONG = Analysis({"case.yaml": b"system: 3\n"}, (f"conf={GIVEN}/case.yaml", f"output={FOUND}"), 90)


@pytest.fixture(scope="module")
def on_cluster() -> Iterator[Analysts]:
    pytest.importorskip("distributed")
    with open_analysts(Cluster("local", 2), 1) as analysts:
        assert analysts.count == 2
        yield analysts


def test_a_wrong_case_is_answered_alike_here_and_on_a_cluster(on_cluster) -> None:
    here, there = LocalAnalysts(1).analyse(WRONG), on_cluster.analyse(WRONG)
    assert here.problem is not None and "system" in here.problem
    assert there.problem is not None and not here.lost and not there.lost
    # The folders have names of their own.
    assert here.problem.split(": ", 2)[2] == there.problem.split(": ", 2)[2]


def test_a_worker_that_dies_is_made_up_for(on_cluster, tmp_path, monkeypatch) -> None:
    monkeypatch.setattr(module, "analyse", die_once)
    answer = on_cluster.analyse(Analysis({}, (str(tmp_path / "tried"),), 90))
    assert answer.problem is None and (tmp_path / "tried").exists()


def test_a_case_that_kills_its_workers_has_no_answer(on_cluster, monkeypatch) -> None:
    monkeypatch.setattr(module, "analyse", die_always)
    answer = on_cluster.analyse(Analysis({}, (), 90))
    assert answer.lost and answer.problem is not None and "ends its worker" in answer.problem


def test_an_analysis_beyond_its_limit_is_ended() -> None:
    answer = analyse(Analysis(WRONG.files, WRONG.words, 0.1))
    assert answer.lost and answer.problem == "no answer within 0.1 s"


def test_an_interruption_ends_the_analyses_and_answers_none() -> None:
    analysts, started = LocalAnalysts(2), threading.Event()
    answers: list[object] = []

    def run(case: int) -> None:
        started.set()
        answers.append(analysts.analyse(WRONG))

    def interrupt(_: None) -> None:
        raise KeyboardInterrupt

    def first(case: int) -> None:
        if case:
            run(case)
        started.wait()

    began = time.perf_counter()
    with pytest.raises(KeyboardInterrupt):
        run_all(first, [0, 1], 2, interrupt, analysts.stop)
    assert not answers and time.perf_counter() - began < 60
    with pytest.raises(NotAnsweredError):
        analysts.analyse(WRONG)
