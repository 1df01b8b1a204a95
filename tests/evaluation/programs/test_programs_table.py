"""The table of programs from end to end, without an analysis: findings are invented."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from dashred.__main__ import main
from dashred.config import load_config
from dashred.core.errors import DONE, InputError
from dashred.core.findings.findings import freeze, write_json_atomic
from dashred.evaluation.case_rows import Case, read_rows
from dashred.evaluation.isolation.worker import Worker, WorkerLostError
from dashred.evaluation.programs import run
from dashred.evaluation.programs.arguments import read_words
from dashred.evaluation.programs.bundled_steps import TALLY
from dashred.evaluation.programs.hidden_equations import hide_equations
from dashred.evaluation.twins.twin_file import read_twin
from tests.evaluation.foreign.invented import findings_of

CASE = Case("mass_spring", "a", 7)


@pytest.mark.parametrize(
    ("words", "message", "hint"),
    [
        (["programs"], "which action", "run, document"),
        (["programs", "rnu"], "no action 'rnu'", "run"),
        (["programs", "run", "systems=wav"], "no bundled system 'wav'", "wave"),
        (["programs", "run", "seed=1"], "unknown key seed", "seeds"),
    ],
)
def test_a_mistake_is_told_with_what_to_do(words: list[str], message: str, hint: str) -> None:
    with pytest.raises(InputError) as caught:
        main(["evaluate", *words])
    assert message in caught.value.what
    assert hint in f"{caught.value.what} {caught.value.hint}"


def test_the_equations_are_hidden(tmp_path: Path) -> None:
    path = tmp_path / "wave.yaml"
    trust = hide_equations("wave", tmp_path / "recording.nc", path)
    told = yaml.safe_load(path.read_text())
    assert trust == "bundled_steps.wave"
    assert not {"equations", "structure", "energy"} & told["system"].keys()
    assert told["system"]["integrator"] == {} and told["recording"].keys() == {"path"}
    config = load_config([f"conf={path}", f"trust={trust}"], entry="train")
    assert config.system.simulator is not None and not config.system.simulator.keep


def test_a_row_is_run_once_scored_and_told(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    output, page = f"output={tmp_path / 'out'}", f"document={tmp_path / 'page.md'}"
    request = read_words(
        ["programs", "run", "systems=mass_spring", "seeds=7", "budget=900", output, page]
    )
    config = load_config(["conf=mass_spring", "recording.twin=a"], entry="record")
    [true] = read_twin(config).terms
    seen: list[dict[str, str]] = []

    def analyse(self: Worker, words: Sequence[str], log: Path, limit: float) -> tuple[int, float]:
        told = dict(word.split("=", 1) for word in words)
        seen.append(told)
        if "trust" not in told:
            raise WorkerLostError("exit code -9")
        # Nothing that was hidden is on disk, and the program is beside the analysis.
        assert not list(tmp_path.rglob("sealed*"))
        copy = Path(told["tracking.root"]).parent
        assert (copy / "bundled_steps.py").is_file()
        np.array([3.0, 40.0, 0.5]).tofile(copy / TALLY)
        found = Path(told["output"])
        found.mkdir()
        section = yaml.safe_load(Path("conf/mass_spring.yaml").read_text())["system"]
        law: dict[str, Any] = {
            "equation": true.equation,
            "term": true.term,
            "parameter": None,
            "region": None,
        }
        law |= {"coefficient": 1.01 * true.coefficient, "std": 0.005 * abs(true.coefficient)}
        law["region"] = None
        write_json_atomic(found / "findings.json", findings_of(section, "missing-term", [law]))
        freeze(found, [])
        return DONE, 12.5

    monkeypatch.setattr(Worker, "analyse", analyse)
    run.run_programs(request)
    [row] = read_rows(request.output)
    assert (row["calls"], row["states"], row["program"]["seconds"]) == (3, 40, 12.5)
    assert row["program"]["exact"] and row["program"]["deviation"] == pytest.approx(2.0)
    assert row["equations"]["problem"] == "the process was ended: exit code -9"
    assert {(told["seed"], told["budget"]) for told in seen} == {("7", "900")}
    run.run_programs(request)
    assert len(seen) == 2
    words = ["programs", "document", f"output={request.output}", f"document={request.document}"]
    assert main(["evaluate", *words]) == DONE
    text = request.document.read_text()
    assert "| a | 7 | 900 | missing-term | exact | 1 % | 2 |" in text
