"""The page of all keys agrees with the schema and the defaults, and is committed."""

from __future__ import annotations

from pathlib import Path

import pytest

from dashred.config.bundled_systems import BASE
from dashred.config.reference import keys, page, unit
from dashred.config.reference_command import main
from dashred.config.schema.types import kind_at
from dashred.config.source import read_file
from dashred.core.errors import InputError

DOCS = Path(__file__).resolve().parents[2] / "docs"
KEYS = {key.name: key for key in keys()}


def test_the_committed_page_is_the_one_that_is_made() -> None:
    committed = (DOCS / "config.md").read_text(encoding="utf-8")
    assert committed == page(), "run: dashred reference path=docs/config.md"


def test_every_default_is_on_the_page() -> None:
    lines = read_file(BASE, label="conf/base.yaml").lines
    told = {name for name, key in KEYS.items() if key.default is not None}
    sections = {name.rpartition(".")[0] for name in KEYS} | {"splits", "system"}
    assert {name for name in lines if name and "[" not in name} <= told | sections


def test_every_key_on_the_page_is_a_key_with_a_meaning() -> None:
    for name, key in KEYS.items():
        kind_at(name, lambda _: "the page")
        assert key.meaning.strip(), f"{name} has no text below it in schema.py"


@pytest.mark.parametrize(
    ("name", "counts_in"),
    [
        ("recording.every", "the system's time"),
        ("shred.lags", "samples"),
        ("latent_sindy.steps", "samples"),
        ("system.axes.NAME.length", "the system's space"),
        ("shred.rate", None),
    ],
)
def test_a_number_states_its_unit(name: str, counts_in: str | None) -> None:
    assert unit(KEYS[name].kind) == counts_in


@pytest.mark.parametrize(
    ("name", "row"),
    [
        ("seed", "whole number at least 0 and below 4294967296 |  | `0` |"),
        ("splits.time.test", "number above 0 and below 0.9 | the record | `0.2` |"),
        (
            "system.axes.NAME.points",
            "whole number at least 8 and at most 1000000 |  | *must be given* |",
        ),
        ("library", "lists of texts, by name; or `null` |  | `null` |"),
        (
            "latent_sindy.steps",
            "list of whole numbers, each at least 1 and at most 1000000 | samples | `[1, 2, 5]` |",
        ),
        ("system.axes.NAME.ends", "see the meaning |  | `periodic` |"),
    ],
)
def test_a_row_has_type_limits_unit_and_default(name: str, row: str) -> None:
    [line] = [line for line in page().splitlines() if line.startswith(f"| `{name}` |")]
    assert line.endswith(f"| {row}")


def test_it_is_written_or_printed(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "config.md"
    assert main([f"path={path}"]) == 0
    assert path.read_text(encoding="utf-8") == page()
    capsys.readouterr()
    assert main([]) == 0
    assert capsys.readouterr().out == f"{page()}\n"


@pytest.mark.parametrize("words", [["config.md"], ["path="], ["path=a.md", "b"]])
def test_wrong_words_are_refused(words: list[str]) -> None:
    with pytest.raises(InputError):
        main(words)


def test_a_path_that_cannot_be_written_is_reported(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="cannot be written"):
        main([f"path={tmp_path / 'none' / 'config.md'}"])
