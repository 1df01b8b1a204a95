"""Arguments are declared once: the values, the errors and the usage text follow."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import pytest

from dashred.core.command_line.argument_types import (
    integer_reader,
    list_reader,
    ranges_reader,
    read_number,
    read_path,
)
from dashred.core.command_line.arguments import Command, argument, key_value_pairs
from dashred.core.errors import InputError


@dataclass(frozen=True, kw_only=True)
class Arguments:
    """Of an example."""

    path: Path = argument(read_path, "FILE.csv", "where to write")
    jobs: int = argument(
        integer_reader(at_least=1, at_most=64), "2", "processes at once", default="1"
    )
    noise: tuple[float, ...] = argument(list_reader(read_number), "0.1,0.2", "std", default="0.05")
    root: str | None = argument(str, "DIR", "folder", name="tracking.root", default=None)
    folder: Path = argument(read_path, "DIR", "where one is", factory=Path.cwd)


COMMAND = Command("dashred example", Arguments, "Writes an example.", after="Then look at it.\n")


def test_words_are_values_of_their_types() -> None:
    found = COMMAND.read(["jobs=3", "path=a=b.csv", "noise=1,.5,1", "tracking.root=here"])
    assert found == Arguments(path=Path("a=b.csv"), jobs=3, noise=(1.0, 0.5), root="here")
    assert found.folder == Path.cwd()
    assert COMMAND.read(["path=~"]).path == Path.home()


@pytest.mark.parametrize(
    ("words", "says", "hint"),
    [
        ([], "path= is missing", "dashred example path=FILE.csv [jobs=2]"),
        (["path"], "expected key=value, got 'path'", "see --help"),
        (["--path=a"], "expected key=value", "write path=a"),
        (["cell.yaml"], "expected key=value, got 'cell.yaml'", "write conf=cell.yaml"),
        (["data/cell.csv"], "expected key=value, got 'data/cell.csv'", "path=data/cell.csv"),
        (["=a"], "expected key=value", "see --help"),
        (["path=a", "path=b"], "path= is given twice", "keep one"),
        (["path="], "path= is empty", "for example path=FILE.csv"),
        (["paht=a"], "unknown key paht", "did you mean path?"),
        (["root=a"], "unknown key root", "tracking.root"),
        (["jobs=0"], "jobs=0: 0 is not between 1 and 64", "for example jobs=2"),
        (["jobs=1.5"], "jobs=1.5: '1.5' is not a whole number", "for example jobs=2"),
        (["noise=1,,2"], "noise=1,,2: there is an empty value", "for example noise=0.1,0.2"),
        (["noise=nan"], "noise=nan: 'nan' is not a number", "for example noise"),
        (["path=\0"], "is not a valid file name", None),
    ],
)
def test_a_wrong_word_is_refused(words: list[str], says: str, hint: str | None) -> None:
    with pytest.raises(InputError) as caught:
        COMMAND.read(words)
    assert says in caught.value.what and caught.value.where == "command line"
    assert hint is None or (caught.value.hint and hint in caught.value.hint)


def test_keys_that_are_known_elsewhere_are_suggested_too() -> None:
    with pytest.raises(InputError) as caught:
        COMMAND.read(["path=a", "shread.lags=3"], others=["shred"])
    assert caught.value.hint and "shred" in caught.value.hint


def test_the_usage_text_has_every_word(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as ended:
        COMMAND.read(["--help"])
    assert ended.value.code == 0
    out = capsys.readouterr().out
    assert out == (
        "usage: dashred example path=FILE.csv [jobs=2] [noise=0.1,0.2] [tracking.root=DIR]"
        " [folder=DIR]\n\n"
        "Writes an example.\n\n"
        "  path=FILE.csv       where to write\n"
        "  jobs=2              processes at once; default: 1\n"
        "  noise=0.1,0.2       std; default: 0.05\n"
        "  tracking.root=DIR   folder\n"
        "  folder=DIR          where one is\n\n"
        "Then look at it.\n"
    )
    passing_on = Command("dashred example", Arguments, "", rest="of every run").usage()
    assert passing_on.startswith("usage: dashred example path=FILE.csv [key=value ...]\n")
    assert "  key=value           of every run\n" in passing_on


def test_pairs_split_at_the_first_sign() -> None:
    assert list(key_value_pairs(["a=b=c", "x.y="])) == [("a", "b=c"), ("x.y", "")]


def test_ranges_count_from_their_first_to_their_last() -> None:
    assert ranges_reader(at_most=5)("4,0-2") == (4, 0, 1, 2)
    with pytest.raises(ValueError, match="more than 5"):
        ranges_reader(at_most=5)("0-5")
