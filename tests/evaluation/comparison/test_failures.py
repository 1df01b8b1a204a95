"""A method that fails is told, and takes no other with it."""

from __future__ import annotations

import json
import re
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
import torch

from dashred.config import frozen_input, load_config
from dashred.core.findings.findings import write_json_atomic
from dashred.core.system_errors import ExternalServiceError
from dashred.evaluation.baselines import kalman_filter
from dashred.evaluation.baselines.analyse import FIELDS, LAWS, attempt
from dashred.evaluation.baselines.estimate import Estimate
from dashred.evaluation.benchmark.arguments import read_words
from dashred.evaluation.benchmark.plan import Row, plan
from dashred.evaluation.comparison import method_scores, other_methods
from dashred.evaluation.comparison.comparison_file import UNRESOLVED, read_comparison
from dashred.evaluation.comparison.method_scores import _score, compare
from dashred.evaluation.comparison.run import _finished, _is_final, compared_row
from dashred.evaluation.twins.sealing import Concealed, SealedTerm
from dashred.inference.initial_state.ensemble_filter import FilterLostError


def test_a_method_that_raises_is_its_own_failure() -> None:
    ended = attempt(lambda: torch.linalg.cholesky(-torch.eye(2)) and None, 2.0)
    assert ended.found is None and ended.failed is not None
    assert "LinAlgError" in ended.failed and "positive-definite" in ended.failed
    assert ended.seconds > 2.0
    none = attempt(lambda: None, 0.0)
    assert none.found is None and none.failed is None


def test_a_field_that_is_not_finite_is_a_failure() -> None:
    states = torch.tensor([[1.0, torch.nan]])
    ended = attempt(lambda: Estimate(states, None, ""), 0.0)
    assert ended.found is None and ended.failed == "its field is not finite"


@pytest.mark.parametrize(
    "refusal",
    [
        OSError("No space left on device"),
        ExternalServiceError("the database is locked"),
        RuntimeError("[enforce fail] DefaultCPUAllocator: can't allocate memory"),
    ],
)
def test_what_the_machine_refuses_is_no_failure_of_a_method(refusal: Exception) -> None:
    def refused() -> Estimate:
        raise refusal

    with pytest.raises(type(refusal), match=re.escape(str(refusal))):
        attempt(refused, 0.0)


def test_a_filter_that_is_lost_says_so(monkeypatch: pytest.MonkeyPatch) -> None:
    def lost(*_: object) -> Any:
        raise FilterLostError("of 24 members only 1 are still whole at t = 3")

    monkeypatch.setattr(kalman_filter, "_filter", lost)
    problem: Any = SimpleNamespace(system=SimpleNamespace(axes=()))
    ensemble: Any = SimpleNamespace(states=torch.zeros(2, 1, 1))
    ended = attempt(lambda: kalman_filter.filter_state(problem, ensemble), 0.0)
    assert ended.failed == (
        "FilterLostError: lost under every setting: of 24 members only 1 are still whole at t = 3"
    )


@pytest.mark.parametrize(
    ("name", "error", "failed", "missed"),
    [
        ("corrected", 0.1, None, 1),
        ("filter_augmented", None, "LinAlgError: singular", 1),
        ("filter_state", float("nan"), None, None),
    ],
)
def test_a_method_without_a_law_has_missed_all_terms(
    name: str, error: float | None, failed: str | None, missed: int | None
) -> None:
    true: Any = {("u", "u", None): -0.1}
    errors = {} if error is None else {name: error}
    ended = {"terms": None, "note": "", "failed": failed, "seconds": 1.0}
    told = _score({}, true, errors, name, ended)
    assert told["missed"] == missed
    assert told["exact"] is (None if missed is None else False)
    if name == "filter_state":
        assert told["rmse"] is None and told["failed"] == "its field is not finite"


def test_a_true_law_among_the_rivals_of_ambiguous_findings_is_listed() -> None:
    config = frozen_input(load_config(["conf=fhn"], entry="train"))
    truth: Any = SimpleNamespace(
        terms=(SealedTerm("v", "v**2", 0.03),), concealed=Concealed(parameters={})
    )
    right = {"equation": "v", "term": "v**2", "coefficient": 0.031, "region": None}
    wrong = right | {"equation": "u"}
    rival = {"terms": [right | {"window": None}], "rival": True}
    findings: dict[str, Any] = {
        "verdict": "ambiguous",
        "terms": [wrong],
        "alternatives": [rival],
        "input": {"config": config},
    }
    assert method_scores._listed(findings, truth) is True
    assert method_scores._listed(findings | {"alternatives": []}, truth) is False
    assert method_scores._listed(findings | {"verdict": "missing-term"}, truth) is None


def unresolved(folder: Path) -> None:
    """Leave what an analysis does that finds the simulator unresolved: no field."""
    folder.mkdir(parents=True)
    findings = {"verdict": "unresolved-numerics", "terms": None}
    (folder / "findings.json").write_text(json.dumps(findings))
    (folder / LAWS).write_text("of an earlier attempt")


def test_a_simulator_that_is_not_resolved_is_told_and_not_compared(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    ran = []

    def run(module: str, words: list[str]) -> int:
        ran.append(module)
        return 0

    unresolved(tmp_path / "row")
    monkeypatch.setattr(other_methods, "_run", run)
    assert other_methods.main([f"folder={tmp_path / 'row'}", "noise=0.1", "conf=rde"]) == 0
    assert ran == ["dashred.evaluation.comparison.method_scores"]
    assert not (tmp_path / "row" / LAWS).exists()
    comparison = compare(tmp_path / "row", 0.1, 0)
    assert (comparison["problem"], comparison["methods"]) == (UNRESOLVED, {})


def test_the_analysis_is_scored_where_the_others_fail_as_a_whole(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "recording.nc").touch()
    (tmp_path / "estimates.nc").touch()
    codes = {
        "dashred.evaluation.baselines.analyse": 3,
        "dashred.evaluation.comparison.method_scores": 0,
    }
    ran = []

    def run(module: str, words: list[str]) -> int:
        ran.append(module)
        return codes[module]

    monkeypatch.setattr(other_methods, "_run", run)
    assert other_methods.main([f"folder={tmp_path}", "noise=0.1", "conf=rde"]) == 3
    assert ran == list(codes)
    assert not (tmp_path / FIELDS).exists()


def row_of(output: Path, twin: str) -> Row:
    [row] = plan(read_words(["systems=rde", f"twins={twin}", f"output={output}"]))
    return row


def keep(row: Row, **more: Any) -> None:
    """Leave the record of a row."""
    row.folder.mkdir(parents=True, exist_ok=True)
    (row.folder / "row.json").write_text(json.dumps({"key": row.key, "problem": None} | more))


def test_a_row_that_died_stays_among_the_rows(tmp_path: Path) -> None:
    row = row_of(tmp_path, "a")
    keep(row, problem="error: the hidden truth blows up", exit_code=2)
    told = compared_row(row)
    assert told.problem == "error: the hidden truth blows up" and told.methods == {}
    assert told.record["law"] is True and told.record["system"] == "rde"


def test_a_row_whose_scoring_died_says_of_what(tmp_path: Path) -> None:
    row = row_of(tmp_path, "b")
    keep(row)
    (row.folder / "findings.json").write_text("{}")
    (row.folder / "other_methods.txt").write_text("Traceback\n  a line\nKeyError: 'noise'\n")
    _finished(row, 1, 2.0)
    told = compared_row(row)
    assert told.problem == "not compared: KeyError: 'noise'"
    assert not _is_final(row)


def test_an_unresolved_row_is_settled(tmp_path: Path) -> None:
    row = row_of(tmp_path, "c")
    unresolved(row.folder)
    keep(row, verdict="unresolved-numerics")
    assert not _is_final(row)
    write_json_atomic(row.folder / "compared.json", compare(row.folder, row.noise, row.seed))
    assert read_comparison(row.folder) is not None and _is_final(row)
    assert compared_row(row).problem == UNRESOLVED
