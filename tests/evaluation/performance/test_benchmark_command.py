"""The command: what it refuses, what it keeps, and one small measurement from end to end."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from dashred.__main__ import main
from dashred.core.errors import DONE, OUR_FAILURE, InputError
from dashred.evaluation.performance import arguments, rows, run
from dashred.evaluation.performance.arguments import read_words
from dashred.evaluation.performance.plan import Task
from dashred.evaluation.performance.rows import Row, is_done, read_rows
from tests.conftest import CHECKOUT
from tests.evaluation.performance.invented_rows import growth_row, stored


@pytest.mark.parametrize(
    ("words", "message", "hint"),
    [
        (["parts=gird"], "there is no part 'gird'", "parts=grid"),
        (["parts="], "parts= is empty", "parts=grid"),
        (["grid=8"], "8 is not between 16 and 1024", "grid=32,64"),
        (["systems=rdee"], "no bundled system 'rdee'", "systems="),
        (["largest=64"], "unknown key largest", "one of: parts"),
    ],
)
def test_a_mistake_is_told_with_what_to_do(words: list[str], message: str, hint: str) -> None:
    with pytest.raises(InputError) as caught:
        main(["benchmark", *words])
    assert message in caught.value.what
    assert caught.value.hint and hint in f"{caught.value.what} {caught.value.hint}"


def test_an_output_that_is_a_file_ends_with_one_message(tmp_path: Path) -> None:
    (tmp_path / "rows").write_text("")
    words = ["parts=grid", f"output={tmp_path / 'rows'}", f"document={tmp_path / 'page.md'}"]
    ended = subprocess.run(
        [sys.executable, "-m", "dashred", "benchmark", *words],
        cwd=CHECKOUT,
        capture_output=True,
        text=True,
    )
    assert ended.returncode == 2
    assert ended.stderr.startswith(f"error: {tmp_path / 'rows'}: this folder cannot be created")
    assert "Traceback" not in ended.stderr
    assert not (tmp_path / "page.md").exists()


def test_the_cluster_needs_its_package(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(arguments, "find_spec", lambda name: None)
    with pytest.raises(InputError, match="distributed, which is not installed") as caught:
        read_words(["parts=cluster"])
    assert caught.value.hint and "dashred[cluster]" in caught.value.hint
    assert read_words(["parts=grid"]).parts == ("grid",)


class Measured:
    """Stands in for the processes that measure; stops or fails at one size."""

    def __init__(self) -> None:
        """Nothing is measured yet."""
        self.sizes: list[int] = []
        self.errors: dict[int, BaseException] = {}

    def __call__(self, asked: dict[str, Any], log: Path) -> Row:
        """Return an invented row of the size that is asked for."""
        size = asked["setting"]["sensors"]
        if size in self.errors:
            raise self.errors[size]
        self.sizes.append(size)
        row = growth_row("sensors", size)
        return {name: row[name] for name in ("pieces", "memory")}


@pytest.fixture
def measured(monkeypatch: pytest.MonkeyPatch) -> Measured:
    found = Measured()
    monkeypatch.setattr(run, "in_child", found)
    return found


@pytest.fixture
def words(tmp_path: Path) -> list[str]:
    """Words of a benchmark of three rows that leaves nothing in the checkout."""
    places = [f"output={tmp_path / 'out'}", f"document={tmp_path / 'page.md'}"]
    return ["benchmark", "parts=sensors", "sensors=8,16,32", *places]


def test_an_interrupted_benchmark_goes_on_with_the_missing_rows(
    words: list[str], measured: Measured
) -> None:
    request = read_words(words[1:])
    measured.errors[16] = KeyboardInterrupt()
    with pytest.raises(KeyboardInterrupt):
        main(words)
    assert [row["size"] for row in read_rows(request.output)] == [8]
    assert not request.document.exists()
    measured.errors.clear()
    assert main(words) == DONE
    assert measured.sizes == [8, 16, 32]
    assert "| sensors | 1.00 ± 0.00 |" in request.document.read_text()
    # All rows are there: nothing is measured, and the page is written again.
    request.document.unlink()
    assert main(words) == DONE
    assert measured.sizes == [8, 16, 32] and request.document.exists()
    # Other repeats are another measurement.
    assert main([*words, "repeats=4"]) == DONE
    assert measured.sizes == [8, 16, 32, 8, 16, 32]


def test_a_row_that_fails_is_told_and_tried_again(
    words: list[str], measured: Measured, capsys: pytest.CaptureFixture[str]
) -> None:
    measured.errors[32] = run.MeasurementFailedError("exit code -9: killed")
    assert main(words) == OUR_FAILURE
    assert "[3/3] sensors 32: failed: exit code -9: killed" in capsys.readouterr().out
    page = read_words(words[1:]).document.read_text()
    assert "| 16 |" in page and "| 32 |" not in page
    measured.errors.clear()
    assert main(words) == DONE
    assert measured.sizes == [8, 16, 32]


def test_without_a_single_row_there_is_nothing_to_write(
    words: list[str], measured: Measured
) -> None:
    measured.errors = {size: run.MeasurementFailedError("no") for size in (8, 16, 32)}
    with pytest.raises(InputError, match="no row was measured"):
        main(words)
    assert not read_words(words[1:]).document.exists()


def test_a_page_without_a_place_is_refused_before_anything_is_measured(
    words: list[str], measured: Measured
) -> None:
    read_words(words[1:]).document.write_text("# Mine\n")
    with pytest.raises(InputError, match="no place for the figures"):
        main(words)
    assert measured.sizes == []


def test_a_process_that_ends_without_a_result_says_why(tmp_path: Path) -> None:
    asked = {"setting": {"points": -1}, "pieces": [], "repeats": 1, "floor": False}
    with pytest.raises(run.MeasurementFailedError, match=r"exit code 1: .*points"):
        run.in_child(asked, tmp_path / "log.txt")


def test_rows_of_another_machine_are_measured_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    stored(tmp_path, growth_row("sensors", 8))
    task = Task("sensors", 8, 3)
    assert is_done(tmp_path, task) and len(read_rows(tmp_path)) == 1
    monkeypatch.setattr(rows, "_processor", lambda: "another one")
    assert not is_done(tmp_path, task) and read_rows(tmp_path) == []


def test_a_damaged_row_is_measured_again(tmp_path: Path) -> None:
    stored(tmp_path, growth_row("sensors", 8))
    (tmp_path / "rows" / "sensors-8.json").write_text('{"part": "sens')
    assert not is_done(tmp_path, Task("sensors", 8, 3)) and read_rows(tmp_path) == []


def test_a_small_measurement_from_end_to_end(tmp_path: Path) -> None:
    output, page = tmp_path / "out", tmp_path / "page.md"
    given = ["parts=grid,jobs", "grid=16,24", "workers=1,2", "repeats=1"]
    given += [f"output={output}", f"document={page}"]
    ended = subprocess.run(
        [sys.executable, "-m", "dashred", "benchmark", *given],
        cwd=CHECKOUT,
        env=os.environ | {"NO_COLOR": "1"},
        capture_output=True,
        text=True,
    )
    assert ended.returncode == DONE, ended.stderr
    found = {(row["part"], row["size"]): row for row in read_rows(output)}
    assert found.keys() == {("grid", 16), ("grid", 24), ("jobs", 1), ("jobs", 2)}
    for size in (16, 24):
        row = found["grid", size]
        march, columns = row["pieces"]["march"], row["pieces"]["columns"]
        # 8 trajectories over 10 steps; 16 modes and 16 terms over 10 steps.
        assert march["work"]["trajectory steps"] == 80
        assert columns["work"]["column steps"] == 320
        # The march makes no more transforms than the scheme needs, and two at each of 5 samples.
        assert march["work"]["transforms"] == 80 * row["floor"]["march"]["transforms"] + 8 * 5 * 2
        for piece in ("march", "columns"):
            measured = row["pieces"][piece]["seconds"]
            assert measured > 0 and row["floor"][piece]["seconds"] > 0
        assert 100 < row["before"] <= row["memory"] < 4000
    text = page.read_text()
    assert "| grid points |" in text and "| jobs= | 2 | 16 cases, each" in text
    assert json.loads(page.with_suffix(".jsonl").read_text().splitlines()[0])["part"] == "grid"
