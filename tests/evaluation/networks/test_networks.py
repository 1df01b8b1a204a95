"""The table of networks: its words, its page, and a row from a recording to its ratios."""

from __future__ import annotations

import subprocess
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from dashred.__main__ import main
from dashred.core.errors import DONE, InputError
from dashred.core.findings.findings import write_json_atomic
from dashred.evaluation.baselines.assimilations import VARIANTS
from dashred.evaluation.case_rows import read_rows
from dashred.evaluation.networks import run
from dashred.evaluation.networks.arguments import read_words
from dashred.evaluation.networks.document import METHODS, document
from dashred.evaluation.networks.rows import LawScore, Row, hides_a_law, is_exact, ratio

EXACT = LawScore(found=1, spurious=0, missed=0, error=0.01)
NOTHING = LawScore(found=0, spurious=0, missed=0, error=None)
WRONG = LawScore(found=0, spurious=2, missed=1, error=None)


def row_of(dynamics: float, law: LawScore, **changes: Any) -> Row:
    rmse = dict.fromkeys(METHODS, 0.1) | {"simulation": 1.0, "dynamics": dynamics}
    row = Row(
        system="heat",
        twin="a",
        seed=3,
        noise=0.01,
        problem=None,
        rmse=rmse,
        laws={"alg1": WRONG, "dynamics": law},
        seconds=dict.fromkeys(VARIANTS, 20.0),
    )
    row.update(changes)  # type: ignore[typeddict-item]
    return row


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["networks"], "which action"),
        (["networks", "rnu"], "no action 'rnu'"),
        (["networks", "run", "systems=heta"], "no bundled system 'heta'"),
        (["networks", "run", "noise=little"], "little"),
    ],
)
def test_a_mistake_is_told(words: list[str], message: str) -> None:
    with pytest.raises(InputError) as caught:
        main(["evaluate", *words])
    assert message in f"{caught.value.what} {caught.value.hint}"


def test_laws_are_compared_term_by_term() -> None:
    assert is_exact(EXACT) and is_exact(NOTHING) and not is_exact(WRONG)
    assert hides_a_law(row_of(0.02, EXACT)) and hides_a_law(row_of(0.02, WRONG))
    assert not hides_a_law(row_of(0.02, NOTHING))
    assert ratio(row_of(0.02, EXACT), "dynamics", "simulation") == pytest.approx(0.02)


def test_the_page_counts_systems_laws_and_nulls() -> None:
    rows = [
        row_of(0.02, EXACT),
        row_of(0.09, WRONG, system="wave"),
        row_of(0.03, NOTHING, twin="null"),
        row_of(0.2, EXACT, noise=0.05),
        row_of(0.2, EXACT, system="rde", problem="no answer within 9 s"),
    ]
    text = document(rows)
    # At 1 %: three rows; of two systems one has half of SHRED's error, both a tenth of the
    # simulation's; one of two laws is exact.
    assert "| 1 % | 3 | 1 of 2 | 2 of 2 | 0.90 | 1/2 = 50 %" in text
    assert "| 5 % | 1 | 0 of 1 | 0 of 1 | 2.00 | 1/1 = 100 %" in text
    assert "1 missed, 2 too many" in text and "no answer within 9 s" in text
    lines = [line for line in text.splitlines() if line.startswith("| heat | null | 3 |")]
    assert lines[0].endswith("| 0.3 | exact |")


def test_a_row_without_a_variant_has_an_empty_cell() -> None:
    lacking = row_of(0.02, EXACT)
    del lacking["rmse"]["dynamics_of_algorithm_1"]
    text = document([lacking, row_of(0.02, EXACT, seed=4)])
    assert "| heat | a | 3 | 1 % | 1 | 0.1 | 0.1 | 0.02 | 0.1 | 0.1 |  | 0.1 | 0.2 |" in text
    assert "| yes | yes | yes | latent, Algorithm 1 | 1 | 1 | 0 | 0 | 20 |" in text


def test_no_rows_are_told(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no rows"):
        main(["evaluate", "networks", "document", f"output={tmp_path}"])


def test_the_process_of_the_networks_sees_the_recording_alone(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    seen: list[tuple[list[str], set[str]]] = []

    def started(command: list[str], **_: Any) -> Any:
        [path] = (word.partition("=")[2] for word in command if word.startswith("recording.path="))
        seen.append((command, {each.name for each in Path(path).parent.iterdir()}))
        raise subprocess.TimeoutExpired(command, 9)

    # The module of this name starts other processes, too.
    own = SimpleNamespace(
        run=started, STDOUT=subprocess.STDOUT, TimeoutExpired=subprocess.TimeoutExpired
    )
    monkeypatch.setattr(run, "subprocess", own)
    words = ["run", "systems=mass_spring", "seeds=7", "limit=9"]
    request = read_words(["networks", *words, f"output={tmp_path / 'out'}"])
    run.run_networks(request)
    [row] = read_rows(request.output)
    assert row["problem"] == "no answer within 9 s" and not row["rmse"]
    [(command, files)] = seen
    assert files == {"recording.nc", "log.txt"}
    assert not any("twin" in word or "noise" in word for word in command)
    run.run_networks(request)
    assert len(seen) == 1


@pytest.mark.slow
def test_dynamics_lower_the_error_of_an_oscillator(tmp_path: Path) -> None:
    output, page = tmp_path / "out", tmp_path / "page.md"
    words = ["systems=mass_spring", "seeds=5", f"output={output}"]
    assert main(["evaluate", "networks", "run", *words]) == DONE
    [row] = read_rows(output)
    assert row["problem"] is None and set(METHODS) < set(row["rmse"])
    assert ratio(row, "dynamics", "shred") < 0.7 and is_exact(row["laws"]["dynamics"])
    write_json_atomic(output / "rows" / "other.json", row)
    words = [f"output={output}", f"document={page}"]
    assert main(["evaluate", "networks", "document", *words]) == DONE
    assert "| 1 % | 2 |" in page.read_text() and page.with_suffix(".jsonl").is_file()
