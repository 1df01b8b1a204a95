"""Every command that the documents show works.

The cheap ones are run as a reader would, one after the other, in a folder of their own. Of the dear
ones the words are read by the entry point's own reader; the analyses of the tutorial and of the
reader's own systems are run when there is time. A command of no category fails, so that none stands
there unchecked.
"""

from __future__ import annotations

import os
import re
import shlex
import shutil
import subprocess
import sys
import tomllib
import warnings
from collections.abc import Callable, Iterator
from functools import partial
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from math import cos, exp, sin
from pathlib import Path
from threading import Thread

import pytest

from tests.documents import blocks, snippets

CHECKOUT = Path(__file__).resolve().parents[2]
SHARED = CHECKOUT.parent / "shared" / "data"
RECORDING = SHARED / "pendulum_single" / "recording.csv"
DOCUMENTS = [CHECKOUT / "README.md", *sorted((CHECKOUT / "docs").glob("*.md"))]
COMMAND = re.compile(r"(dashred|python -m|make|pip|mlflow) ")
DISPATCHER = [sys.executable, "-m", "dashred"]
SECONDS = 300
LONGEST = 3600


def commands(document: Path) -> list[list[str]]:
    """Return the words of every command of a document, without what follows a #.

    In a block of ```sh every line is one; in others those that look like one.
    """
    found = []
    for language, body in blocks(document):
        for line in body.replace("\\\n", " ").splitlines():
            if language == "sh" or COMMAND.match(line.strip()):
                found.append(shlex.split(line, comments=True))
    return [words for words in found if words]


def run(words: list[str], folder: Path) -> None:
    """Run a command of the package in a folder."""
    assert words[0] == "dashred"
    ended = subprocess.run(
        [*DISPATCHER, *words[1:]],
        cwd=folder,
        env=os.environ | {"PYTHONPATH": str(CHECKOUT), "NO_COLOR": "1", "COLUMNS": "200"},
        capture_output=True,
        text=True,
        timeout=LONGEST,
    )
    # What init has written is checked before the reader has filled it in.
    open_lines = words[1] == "check" and " left to do (!)" in ended.stdout
    assert ended.returncode == (2 if open_lines else 0), f"{shlex.join(words)}\n{ended.stderr}"
    assert "Traceback" not in ended.stderr
    assert ended.stdout.strip()


def fetch(words: list[str], folder: Path) -> None:
    """Run ``dashred fetch``, from a server on this machine that has the shared data.

    Where that is not there, what comes after gets a swing of our own, and the words are read.
    """
    if not RECORDING.is_file():
        [path] = [word.removeprefix("path=") for word in words if word.startswith("path=")]
        shutil.copy(folder / "my.csv", folder / path)
        run([*words[:2], "--help"], folder)
        return
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


def pip_words(words: list[str], folder: Path) -> None:
    """Hold the name of the wheel against the version of the package; nothing is installed."""
    with (CHECKOUT / "pyproject.toml").open("rb") as file:
        version = tomllib.load(file)["project"]["version"]
    if words[1] == "install":
        assert words[2:] == [f"build/dashred-{version}-py3-none-any.whl"]
    else:
        assert words[1:] == ["wheel", "--no-deps", "--wheel-dir", "build", "."]


def arguments(words: list[str]) -> list[str]:
    """Return the arguments of ``dashred COMMAND ...`` or ``python -m dashred.train ...``."""
    return words[2:] if words[0] == "dashred" else words[3:]


def train_words(words: list[str], folder: Path) -> None:
    """Read the words of an analysis; what they name need not be there yet.

    A class that is trusted would be imported, and the reader's own is not here. A program is not.
    """
    from dashred.config import load_config

    given = arguments(words)
    system = folder / given[0].removeprefix("conf=")
    if not (system.is_file() and "simulator:" in system.read_text(encoding="utf-8")):
        given = [word for word in given if not word.startswith("trust=")]
    load_config(given, entry="train")


def resume_words(words: list[str], folder: Path) -> None:
    """Ask for a run that is not there: the words are right, the run is not."""
    command = [*DISPATCHER, *words[1:], f"tracking.root={folder / 'mlruns'}"]
    environment = os.environ | {"PYTHONPATH": str(CHECKOUT)}
    ended = subprocess.run(command, cwd=folder, env=environment, capture_output=True, text=True)
    assert ended.returncode == 2
    assert re.match(r"error: .*(RUN_ID|MLflow store)", ended.stderr), ended.stderr


def mlflow_words(words: list[str], folder: Path) -> None:
    """Hold the options of MLflow's own command against those that it knows."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # what MLflow's server says of SQLAlchemy is not ours
        from mlflow.cli import cli

    server = cli.commands["server"]  # `ui` is another name of it
    known = {name for option in server.params for name in option.opts}
    assert {word for word in words if word.startswith("--")} <= known


def bench_words(words: list[str], folder: Path) -> None:
    """Read the words of a bench, and plan its rows."""
    from dashred.evaluation.benchmark.arguments import read_words
    from dashred.evaluation.benchmark.plan import plan

    assert plan(read_words([w for w in arguments(words) if not w.startswith("document=")]))


def proof_words(words: list[str], folder: Path) -> None:
    """Read the words of a proof; a draw that is named needs no clean checkout."""
    from dashred.evaluation.proof.arguments import read_words

    read_words(["draw=words", *arguments(words)])


def foreign_words(words: list[str], folder: Path) -> None:
    """Read the words of an evaluation; a draw that is named needs no tag."""
    from dashred.evaluation.foreign.arguments import read_words

    read_words([re.sub(r"^tag=", "draw=", word) for word in words[2:]])


def performance_words(words: list[str], folder: Path) -> None:
    """Read the words of a measurement of run times."""
    from dashred.evaluation.performance.arguments import read_words

    read_words(arguments(words))


def program_words(words: list[str], folder: Path) -> None:
    """Read the words of a table of programs."""
    from dashred.evaluation.programs.arguments import read_words

    read_words(words[2:])


def network_words(words: list[str], folder: Path) -> None:
    """Read the words of a table of networks."""
    from dashred.evaluation.networks.arguments import read_words

    read_words(words[2:])


def follow_words(words: list[str], folder: Path) -> None:
    """Read the words of a stream; the run and the source need not be there."""
    from dashred.pipeline.follow.command import COMMAND

    COMMAND.read(words[2:])


Check = Callable[[list[str], Path], None]
CHEAP: dict[str, Check] = {
    r"make [a-z-]+": make,
    r"source .*": activate,
    r"pip (install|wheel) .*": pip_words,
    r"dashred \w+ --help": run,
    r"dashred reference( path=.*)?": run,
    r"dashred fetch path=.*": fetch,
    r"dashred init path=.*": run,
    r"dashred check conf=.*": run,
}
WORDS: dict[str, Check] = {
    r"(dashred |python -m dashred\.)train conf=.*": train_words,
    r"dashred train resume=RUN_ID.*": resume_words,
    r"dashred follow run=.*": follow_words,
    r"mlflow (ui|server) .*": mlflow_words,
    r"dashred (bench|compare) systems=.*": bench_words,
    r"dashred benchmark.*": performance_words,
    r"dashred prove cases=.*": proof_words,
    r"dashred evaluate foreign (plan|run|document) tag=.*": foreign_words,
    r"dashred evaluate programs (run|document).*": program_words,
    r"dashred evaluate networks (run|document).*": network_words,
}
# What `make test-all` runs to the end, by where it leaves its findings; each takes minutes. Benches
# and proofs take hours.
RUNS = {
    "tutorial.md": ["pendulum-run"],
    "own-system.md": ["my_findings", "my_waves"],
}


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
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return a folder as a reader's may be: with `conf/`, and with what is called the reader's own.

    `my.csv` is a swing that dies away; `mine.yaml` is a simulation of it; `swing.nc` is written as
    the page on the reader's own system says. The examples of programs are there, too.
    """
    (tmp_path / "docs").mkdir()
    (tmp_path / "conf").symlink_to(CHECKOUT / "conf")
    shutil.copytree(CHECKOUT / "docs" / "examples", tmp_path, dirs_exist_ok=True)
    rows = ["time,theta,omega"]
    for t in (0.05 * i for i in range(200)):
        rows.append(f"{t:.2f},{exp(-t / 40) * cos(8 * t):.4f},{-8 * exp(-t / 40) * sin(8 * t):.4f}")
    (tmp_path / "my.csv").write_text("\n".join([*rows, ""]))
    shutil.copy(CHECKOUT / "conf" / "pendulum.yaml", tmp_path / "mine.yaml")
    [program] = snippets(CHECKOUT / "docs" / "own-system.md", "python")
    with monkeypatch.context() as there:
        there.chdir(tmp_path)
        exec(program, {})
    return tmp_path


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
        check_of(["dashred", "unheard_of", "path=x"])


def test_a_word_that_does_not_exist_fails(folder: Path) -> None:
    from dashred.core.errors import InputError

    with pytest.raises(InputError):
        train_words(["dashred", "train", "conf=rde", "recording.twni=b"], folder)


def folder_of(words: list[str]) -> str | None:
    """Return where a command leaves its findings, if it says so."""
    return next(
        (word.removeprefix("output=") for word in words if word.startswith("output=")), None
    )


@pytest.mark.slow
@pytest.mark.parametrize("name", RUNS)
def test_a_document_ends_in_verdicts(
    name: str, folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(folder)
    ended = []
    for words in commands(CHECKOUT / "docs" / name):
        if words[:2] != ["dashred", "train"]:
            check_of(words)(words, folder)
        elif folder_of(words) in RUNS[name]:
            run([*words, f"tracking.root={folder / 'mlruns'}"], folder)
            ended.append(folder_of(words))
    assert ended == RUNS[name]
    for output in RUNS[name]:
        summary = (folder / output / "summary.txt").read_text(encoding="utf-8")
        assert summary.startswith("Verdict: ")
        assert (folder / output / "report.html").is_file()
        assert (folder / output / "corrected.yaml").is_file()
