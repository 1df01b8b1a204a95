"""Every command that the documents show works: those in blocks of ```sh.

The cheap ones are run as a reader would, one after the other, in a folder of their own. Of the dear
ones the words are read by the entry point's own reader; the tutorial's analysis is run when there
is time. A command of no category fails, so that none stands there unchecked.
"""

from __future__ import annotations

import os
import re
import shlex
import subprocess
import sys
from collections.abc import Callable, Iterator
from functools import partial
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from threading import Thread

import pytest

CHECKOUT = Path(__file__).resolve().parents[1]
SHARED = CHECKOUT.parent / "shared" / "data"
RECORDING = SHARED / "pendulum_single" / "recording.csv"
DOCUMENTS = [CHECKOUT / "README.md", *sorted((CHECKOUT / "docs").glob("*.md"))]
FENCE = re.compile(r"^( *)```(\w*)\n(.*?)^\1```$", re.MULTILINE | re.DOTALL)
COMMAND = re.compile(r"^\s*(?:\$ )?(?:python -m|make |pip |mlflow )", re.MULTILINE)
MODULE = ["python", "-m"]
SECONDS = 300
LONGEST = 3600


def commands(document: Path) -> list[list[str]]:
    """Return the words of every command of a document, without what follows a #."""
    text = document.read_text(encoding="utf-8")
    blocks = [body for _, language, body in FENCE.findall(text) if language == "sh"]
    lines = "".join(blocks).replace("\\\n", " ").splitlines()
    found = [shlex.split(line, comments=True) for line in lines]
    return [words for words in found if words]


def run(words: list[str], folder: Path) -> None:
    """Run a command of the package in a folder."""
    assert words[:2] == MODULE
    ended = subprocess.run(
        [sys.executable, *words[1:]],
        cwd=folder,
        env=os.environ | {"PYTHONPATH": str(CHECKOUT), "NO_COLOR": "1", "COLUMNS": "200"},
        capture_output=True,
        text=True,
        timeout=LONGEST,
    )
    assert ended.returncode == 0, f"{shlex.join(words)}\n{ended.stderr}"
    assert "Traceback" not in ended.stderr
    assert ended.stdout.strip()


def fetch(words: list[str], folder: Path) -> None:
    """Run ``dashred.fetch``, from a server on this machine that has the shared data."""
    if not RECORDING.is_file():
        pytest.skip(f"{RECORDING} is not there")
    handler = partial(SimpleHTTPRequestHandler, directory=str(SHARED))
    with ThreadingHTTPServer(("127.0.0.1", 0), handler) as server:
        Thread(target=server.serve_forever, daemon=True).start()
        at = f"http://127.0.0.1:{server.server_port}/{RECORDING.relative_to(SHARED)}"
        run([*words, f"source={at}"], folder)
        server.shutdown()


def make(words: list[str], folder: Path) -> None:
    """Let make say what it would do."""
    assert words[0] == "make"
    command = ["make", "-n", "-C", str(CHECKOUT), *words[1:]]
    assert subprocess.run(command, capture_output=True, timeout=SECONDS).returncode == 0


def activate(words: list[str], folder: Path) -> None:
    """Hold the path of the environment against the Makefile's."""
    [venv] = re.findall(r"^VENV := (\S+)$", (CHECKOUT / "Makefile").read_text(), re.MULTILINE)
    assert words == ["source", f"{venv}/bin/activate"]


def train_words(words: list[str], folder: Path) -> None:
    """Read the words of an analysis; what they name need not be there yet."""
    from dashred.config import load_config

    load_config(words[3:], entry="train")


def bench_words(words: list[str], folder: Path) -> None:
    """Read the words of a bench, and plan its rows."""
    from dashred.benchmark.plan import plan
    from dashred.benchmark.words import read_words

    assert plan(read_words([word for word in words[3:] if not word.startswith("document=")]))


def proof_words(words: list[str], folder: Path) -> None:
    """Read the words of a proof; a draw that is named needs no clean checkout."""
    from dashred.proof.words import read_words

    read_words(["draw=words", *words[3:]])


Check = Callable[[list[str], Path], None]
CHEAP: dict[str, Check] = {
    r"make [a-z-]+": make,
    r"source .*": activate,
    r"python -m dashred\.\w+ --help": run,
    r"python -m dashred\.reference path=.*": run,
    r"python -m dashred\.fetch path=.*": fetch,
}
WORDS: dict[str, Check] = {
    r"python -m dashred\.train conf=.*": train_words,
    r"python -m dashred\.(bench|compare) systems=.*": bench_words,
    r"python -m dashred\.prove cases=.*": proof_words,
}
# What `make test-all` runs to the end, in minutes. Benches and proofs take hours.
RUN = r"python -m dashred\.train conf=pendulum recording\.path=pendulum\.csv output=\S+"


def check_of(words: list[str]) -> Check:
    """Return how a command is checked."""
    line = " ".join(words)
    found = [check for pattern, check in (CHEAP | WORDS).items() if re.fullmatch(pattern, line)]
    assert found, (
        f"{line!r} is of no category in tests/{Path(__file__).name}: say how it is checked"
    )
    return found[0]


def names(documents: list[Path]) -> Iterator[str]:
    yield from (str(document.relative_to(CHECKOUT)) for document in documents)


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """Return an empty folder as a reader's would be."""
    (tmp_path / "docs").mkdir()
    return tmp_path


@pytest.mark.parametrize("document", DOCUMENTS, ids=names(DOCUMENTS))
def test_commands_are_marked_as_such(document: Path) -> None:
    """Only what stands in a block of ```sh is checked."""
    text = document.read_text(encoding="utf-8")
    for _, language, body in FENCE.findall(text):
        if language != "sh":
            assert not COMMAND.search(body), f"a command in a block that is not ```sh:\n{body}"


@pytest.mark.parametrize("document", DOCUMENTS, ids=names(DOCUMENTS))
def test_every_command_works_or_its_words_are_read(
    document: Path, folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(folder)
    checks = [(check_of(words), words) for words in commands(document)]
    for check, words in checks:
        check(words, folder)


def test_a_command_of_no_category_fails() -> None:
    with pytest.raises(AssertionError, match="of no category"):
        check_of(["python", "-m", "dashred.unheard_of", "path=x"])


def test_a_word_that_does_not_exist_fails(folder: Path) -> None:
    from dashred.errors import InputError

    with pytest.raises(InputError):
        train_words([*MODULE, "dashred.train", "conf=rde", "recording.twni=b"], folder)


def test_the_tutorial_has_commands_to_run_to_the_end() -> None:
    lines = [" ".join(words) for words in commands(CHECKOUT / "docs" / "tutorial.md")]
    assert any(re.fullmatch(RUN, line) for line in lines)


@pytest.mark.slow
def test_the_tutorial_ends_in_a_verdict(folder: Path) -> None:
    for words in commands(CHECKOUT / "docs" / "tutorial.md"):
        if words[:3] == [*MODULE, "dashred.fetch"]:
            fetch(words, folder)
        elif re.fullmatch(RUN, " ".join(words)):
            run([*words, f"tracking.root={folder / 'mlruns'}"], folder)
    [summary] = folder.rglob("summary.txt")
    assert summary.read_text(encoding="utf-8").startswith("Verdict: ")
    assert (summary.parent / "report.html").is_file()
